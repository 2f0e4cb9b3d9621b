"""An OPC UA client: a robot's state from the variables of its controller or PLC."""
