"""Reads an Equipoise station's states and reports their latency.

    import equipoise

    for reading in equipoise.subscribe("station-1"):
        if not reading:
            print("no value:", reading)   # now the robot goes to its safe speed
        elif reading.invalidated_by(equipoise.SPOILS_TORQUES):
            print("withheld:", reading.reasons)
        else:
            print(reading.torque_nm(equipoise.Joint.L5S1), reading.age_ns)

A `Reading` is a state that may be believed to be current; everything else is a `NoReading` with its reason, and is
false. What a state says may still be withheld: that is `reasons`. Library and daemon must be of one release and run as
the same user; the bus's directory is that of EQUIPOISE_BUS_ROOT, as for the daemon. `equipoise.udp` reads datagrams on any machine.
"""

from ._arrays import to_pandas
from ._bus import BusError
from ._messages import (
    JOINTS,
    SEGMENTS,
    SPOILS_BACK,
    SPOILS_COM,
    SPOILS_COP_ESTIMATED,
    SPOILS_COP_MEASURED,
    SPOILS_DELTA_F,
    SPOILS_GROUND_FORCE,
    SPOILS_LIFTED_MASS,
    SPOILS_RESIDUAL,
    SPOILS_TORQUES,
    Acceleration,
    BodyRefused,
    BodySource,
    GroundDevice,
    Joint,
    Level,
    NotGiven,
    Phase,
    PickUp,
    Reason,
    Sharing,
    Sole,
    State,
)
from .consumer import Consumer, latest, subscribe
from .reading import NoReading, Reading, Why

__all__ = [
    "JOINTS",
    "SEGMENTS",
    "SPOILS_BACK",
    "SPOILS_COM",
    "SPOILS_COP_ESTIMATED",
    "SPOILS_COP_MEASURED",
    "SPOILS_DELTA_F",
    "SPOILS_GROUND_FORCE",
    "SPOILS_LIFTED_MASS",
    "SPOILS_RESIDUAL",
    "SPOILS_TORQUES",
    "Acceleration",
    "BodyRefused",
    "BodySource",
    "BusError",
    "Consumer",
    "GroundDevice",
    "Joint",
    "Level",
    "NoReading",
    "NotGiven",
    "Phase",
    "PickUp",
    "Reading",
    "Reason",
    "Sharing",
    "Sole",
    "State",
    "Why",
    "latest",
    "subscribe",
    "to_pandas",
]
