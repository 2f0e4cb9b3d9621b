"""Universal Robots' controllers over RTDE: joints in; speed slider, watchdog and level out."""
