"""A Modbus TCP server for plants: the newest advice as registers."""

import logging

# pymodbus logs each request that it cannot read; the counters say what there is to say.
_log = logging.getLogger("pymodbus")
_log.addHandler(logging.NullHandler())
_log.setLevel(logging.CRITICAL)
_log.propagate = False
