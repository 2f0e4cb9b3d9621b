"""A Modbus TCP client: a robot's state from the registers of its controller or PLC."""
