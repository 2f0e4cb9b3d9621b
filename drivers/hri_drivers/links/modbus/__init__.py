"""A Modbus TCP server for plants: the newest advice as registers."""

from hri_drivers.wires.quiet import quiet

quiet("pymodbus")  # it logs each request that it cannot read
