"""OptiTrack Motive: skeletons by NatNet."""
