"""Reads an Equipoise station's states and reports their latency; reads, plots and computes recordings.

    import equipoise

    for reading in equipoise.subscribe("station-1"):
        if not reading:
            print("no state:", reading)   # reduce the robot to its safe speed
        elif reading.invalidated_by(equipoise.INVALIDATES_TORQUES):
            print("invalid:", reading.reasons)
        else:
            print(reading.torque_nm(equipoise.Joint.L5S1), reading.age_ns)

A `Reading` is a current state; otherwise a `NoReading` states the reason, and its truth value is false. Values of a
state may be invalid: see `reasons`. Library and daemon must be of one release and run as the same user; the directory
of the bus is that of EQUIPOISE_BUS_ROOT, as for the daemon. `equipoise.udp` reads datagrams on any machine.

    plan = equipoise.plan_handover("station-1", mass_kg=6.0)   # a `HandoverPlan`, or a `NoPlan` with its reason

    states = equipoise.read_recording("session.mcap", columns=["torque_nm", "torque_sigma_nm", "torque_limit_nm"])
    equipoise.plot.torque(states, "L5S1")
"""

from . import plot
from ._arrays import to_pandas
from ._bus import BusError
from ._messages import (
    JOINTS,
    SEGMENTS,
    INVALIDATES_LOW_BACK,
    INVALIDATES_COM,
    INVALIDATES_COP_ESTIMATED,
    INVALIDATES_COP_MEASURED,
    INVALIDATES_DELTA_F,
    INVALIDATES_GROUND_FORCE,
    INVALIDATES_LIFTED_MASS,
    INVALIDATES_LOAD_HAND_DISTANCE,
    INVALIDATES_POSE,
    INVALIDATES_RESIDUAL,
    INVALIDATES_SUIT_COM,
    INVALIDATES_TORQUES,
    Acceleration,
    BodyRejected,
    BodySource,
    CurrentFrame,
    CurrentStatus,
    GroundDevice,
    HandoverRefusal,
    Joint,
    Level,
    Unavailable,
    Phase,
    ConsumerReceipt,
    EarlyState,
    Reason,
    Sharing,
    FootOutline,
    State,
)
from .consumer import Consumer, latest, subscribe
from .planner import HandoverPlan, HandoverPlanner, NoPlan, plan_handover
from .program import ProgramError, reconcile, replay
from .reading import EarlyReading, NoReading, NoStateReason, Reading
from .recording import iter_recording, read_recording, to_numpy

__all__ = [
    "JOINTS",
    "SEGMENTS",
    "INVALIDATES_LOW_BACK",
    "INVALIDATES_COM",
    "INVALIDATES_COP_ESTIMATED",
    "INVALIDATES_COP_MEASURED",
    "INVALIDATES_DELTA_F",
    "INVALIDATES_GROUND_FORCE",
    "INVALIDATES_LIFTED_MASS",
    "INVALIDATES_LOAD_HAND_DISTANCE",
    "INVALIDATES_POSE",
    "INVALIDATES_RESIDUAL",
    "INVALIDATES_SUIT_COM",
    "INVALIDATES_TORQUES",
    "Acceleration",
    "BodyRejected",
    "BodySource",
    "BusError",
    "Consumer",
    "CurrentFrame",
    "CurrentStatus",
    "GroundDevice",
    "HandoverPlan",
    "HandoverPlanner",
    "HandoverRefusal",
    "Joint",
    "Level",
    "NoPlan",
    "NoReading",
    "Unavailable",
    "Phase",
    "ProgramError",
    "ConsumerReceipt",
    "EarlyReading",
    "EarlyState",
    "Reading",
    "Reason",
    "Sharing",
    "FootOutline",
    "State",
    "NoStateReason",
    "iter_recording",
    "latest",
    "plan_handover",
    "plot",
    "read_recording",
    "reconcile",
    "replay",
    "subscribe",
    "to_numpy",
    "to_pandas",
]
