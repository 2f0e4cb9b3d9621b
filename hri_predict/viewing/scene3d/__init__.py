"""The 3D view, by viser: people, forecast, zones and robots in a browser."""
