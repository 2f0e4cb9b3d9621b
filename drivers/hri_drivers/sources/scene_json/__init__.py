"""Scenes as JSON, over TCP and WebSocket."""
