"""The datagrams of the UDP gateway. Generated from its table: do not edit.

    EQUIPOISE_WRITE=1 cargo test -p equipoise-gateways --test wires
"""

from __future__ import annotations

import enum
from typing import NamedTuple, Tuple

MAGIC = b"EQPU"
VERSION = 2
BYTES = 920
# For `struct`.
FORMAT = (
    "< 4s H H 32s Q Q I I Q Q Q Q Q Q Q Q "
    "Q I I I I I 22B H 22f 66f 22f 22f 22f f f f "
    "f 2f 3f f 3f f 3f 2f 2f 3f f f f f f f "
    "I "
)
# Number of elements of each field.
COUNTS = (
    ("magic", 1),
    ("version", 1),
    ("length", 1),
    ("station", 1),
    ("session_ns", 1),
    ("sequence", 1),
    ("status", 1),
    ("phase", 1),
    ("status_ns", 1),
    ("cycle", 1),
    ("state_time_ns", 1),
    ("sample_time_ns", 1),
    ("age_ns", 1),
    ("sample_age_ns", 1),
    ("suit_age_ns", 1),
    ("ground_age_ns", 1),
    ("valid", 1),
    ("usable", 1),
    ("unavailable", 1),
    ("flags", 1),
    ("worst_joint", 1),
    ("lifts", 1),
    ("joint_level", 22),
    ("daemon_life", 1),
    ("torque_magnitude_nm", 22),
    ("torque_nm", 66),
    ("torque_sigma_nm", 22),
    ("torque_limit_nm", 22),
    ("fatigue", 22),
    ("lifted_mass_kg", 1),
    ("lifted_mass_sigma_kg", 1),
    ("load_hand_distance_m", 1),
    ("reach_m", 1),
    ("hand_load_fraction", 2),
    ("advice_direction", 3),
    ("advice_gain_nm_per_cm", 1),
    ("delta_f_n", 3),
    ("delta_f_sigma_n", 1),
    ("ground_force_n", 3),
    ("cop_measured_m", 2),
    ("cop_estimated_m", 2),
    ("com_m", 3),
    ("l5s1_moment_nm", 1),
    ("l5s1_moment_sigma_nm", 1),
    ("l5s1_compression_n", 1),
    ("l5s1_compression_sigma_n", 1),
    ("dose_damage", 1),
    ("dose_probability", 1),
    ("crc32", 1),
)


class Status(enum.IntEnum):
    """Reason why there is no state: `status`."""

    CURRENT = 0
    SILENT = 1
    STALE = 2
    OTHER_CLOCK = 3
    BUS = 4


class Usable(enum.IntFlag):
    """Groups of valid values: bits of `usable`."""

    GROUND_FORCE = 1
    COP_MEASURED = 2
    COM = 4
    COP_ESTIMATED = 8
    DELTA_F = 16
    RESIDUAL = 32
    LIFTED_MASS = 64
    LOW_BACK = 128
    TORQUES = 256


class Datagram(NamedTuple):
    """A datagram. Invalid values are 0.

    Matrices (`torque_nm`: three per joint) are in row-major order.
    """

    magic: bytes
    version: int
    length: int
    station: bytes
    session_ns: int
    sequence: int
    status: int
    phase: int
    status_ns: int
    cycle: int
    state_time_ns: int
    sample_time_ns: int
    age_ns: int
    sample_age_ns: int
    suit_age_ns: int
    ground_age_ns: int
    valid: int
    usable: int
    unavailable: int
    flags: int
    worst_joint: int
    lifts: int
    joint_level: Tuple[int, ...]
    daemon_life: int
    torque_magnitude_nm: Tuple[float, ...]
    torque_nm: Tuple[float, ...]
    torque_sigma_nm: Tuple[float, ...]
    torque_limit_nm: Tuple[float, ...]
    fatigue: Tuple[float, ...]
    lifted_mass_kg: float
    lifted_mass_sigma_kg: float
    load_hand_distance_m: float
    reach_m: float
    hand_load_fraction: Tuple[float, ...]
    advice_direction: Tuple[float, ...]
    advice_gain_nm_per_cm: float
    delta_f_n: Tuple[float, ...]
    delta_f_sigma_n: float
    ground_force_n: Tuple[float, ...]
    cop_measured_m: Tuple[float, ...]
    cop_estimated_m: Tuple[float, ...]
    com_m: Tuple[float, ...]
    l5s1_moment_nm: float
    l5s1_moment_sigma_nm: float
    l5s1_compression_n: float
    l5s1_compression_sigma_n: float
    dose_damage: float
    dose_probability: float
    crc32: int
