"""Servers that publish an arm's state: ``python -m hri_sim.robot_server modbus`` or ``opcua``."""
