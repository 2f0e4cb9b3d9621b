"""The network stream of Xsens MVN."""
