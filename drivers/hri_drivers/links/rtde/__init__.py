"""Universal Robots' controllers by RTDE: joints in; speed slider, watchdog and level out."""
