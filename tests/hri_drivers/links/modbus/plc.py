"""A PLC that speaks Modbus TCP by pymodbus's client: one request per line of JSON, one answer each.

    python plc.py PORT

``{"read": [address, count], "function": 3}``, ``{"write": [address, words]}``, ``{"one": [address,
word]}``, ``{"coils": [address, count]}``; answered by words or an exception.
"""

import json
import sys
from typing import Any

from pymodbus.client import ModbusTcpClient
from pymodbus.exceptions import ModbusException


def answered(client: ModbusTcpClient, asked: dict[str, Any]) -> dict[str, Any]:
    """Send one request, and return what came."""
    if "read" in asked:
        address, count = asked["read"]
        read = client.read_holding_registers if asked.get("function") == 3 else None
        reply = (read or client.read_input_registers)(address, count=count)
    elif "write" in asked:
        reply = client.write_registers(*asked["write"])
    elif "one" in asked:
        reply = client.write_register(*asked["one"])
    else:
        address, count = asked["coils"]
        reply = client.read_coils(address, count=count)
    if reply.isError():
        return {"exception": getattr(reply, "exception_code", -1)}
    return {"words": list(reply.registers)}


def main(port: int) -> None:
    """Answer until the input ends."""
    client = ModbusTcpClient("127.0.0.1", port=port, timeout=2, retries=0)
    for line in sys.stdin:
        try:
            client.connect()
            answer = answered(client, json.loads(line))
        except ModbusException as error:
            answer = {"lost": str(error)}
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]))
