"""Reads a joint's torque by the rules of docs/consumers/opcua.md, with asyncua (pip install asyncua)."""
import time

from asyncua import Client


async def read(adapt, stop):
    """Calls adapt(torque) or stop(name of the status)."""
    client = Client("opc.tcp://192.0.2.7:4840/")
    client.set_user("plc")                  # and await client.set_security(…), before it connects
    client.set_password("…")
    async with client:
        index = await client.get_namespace_index("urn:equipoise:station:1")
        node = client.get_node(f"ns={index};s=station-1/Joints/L5S1/TorqueMagnitude")
        asked_s = time.monotonic()          # a delayed response is as old as its delay
        value = await node.read_data_value(raise_on_bad_status=False)
        if value.StatusCode.is_good() and time.monotonic() - asked_s < 0.2:
            adapt(value.Value.Value)
        else:
            stop(value.StatusCode.name)     # and on every exception: the connection is closed
