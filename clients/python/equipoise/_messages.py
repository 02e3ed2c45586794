"""Layout of shared memory. Generated from the tables of core and bus: do not edit.

    EQUIPOISE_WRITE=1 cargo test -p equipoise-client --test python_module
"""

from __future__ import annotations

import ctypes
import enum
from typing import NamedTuple, Optional

from ._flags import Flags


class Service(NamedTuple):
    """A service: every process must open it with the same settings."""

    suffix: str
    schema: str
    publishers_max: int
    subscribers_max: int
    depth: int
    depth_max: int
    history: int
    deadline_ns: Optional[int]


class RequestService(NamedTuple):
    """A request-response service: every process must open it with the same settings."""

    suffix: str
    schema: str
    overflow_requests: bool
    overflow_responses: bool
    fire_and_forget: bool
    active_requests_max: int
    loaned_requests_max: int
    responses_max: int
    borrowed_responses_max: int
    servers_max: int
    clients_max: int


JOINTS = 22
SEGMENTS = 23
SUB_BUCKETS = 16
BUCKETS = 512
NODES_MAX = 64
BORROWED_MAX = 2
LISTENERS_MAX = 24
NOTIFIERS_MAX = 32
EVENT_NUMBER_MAX = 63
NOTIFIER_DIED = 8
ROOT_BYTES_MAX = 46
HANDOVER_MASS_KG = (0.1, 50.0)
HANDOVER_WIDTH_M = (0.0, 1.0)
HANDOVER_PLACE_MAX_M = 3.0
ROOT_VARIABLE = "EQUIPOISE_BUS_ROOT"
DEFAULT_ROOT = "/tmp/iceoryx2"
SCHEMA_KEY = "equipoise.schema"
EVENTS = "events"
EVENTS_SCHEMA = "events/1"
STATE = Service(
    suffix="state",
    schema="0x9b806290d37abcf6",
    publishers_max=2,
    subscribers_max=24,
    depth=8,
    depth_max=1024,
    history=1,
    deadline_ns=25000000,
)
EARLY_STATE = Service(
    suffix="early",
    schema="0x2b995adb0ced958c",
    publishers_max=2,
    subscribers_max=24,
    depth=4,
    depth_max=256,
    history=1,
    deadline_ns=40000000,
)
CONSUMER_RECEIPT = Service(
    suffix="receipt",
    schema="0x75f254b0e7fc69ea",
    publishers_max=17,
    subscribers_max=2,
    depth=16,
    depth_max=32,
    history=1,
    deadline_ns=None,
)
HANDOVER = RequestService(
    suffix="handover",
    schema="0xf0b80830ba5043cc+0xa837151ed90dab5a",
    overflow_requests=True,
    overflow_responses=True,
    fire_and_forget=False,
    active_requests_max=4,
    loaned_requests_max=1,
    responses_max=1,
    borrowed_responses_max=1,
    servers_max=1,
    clients_max=16,
)


class State(ctypes.Structure):
    """Result of one cycle; see core/src/message/state.rs."""

    cycle: int
    time_ns: int
    suit_sample_time_ns: int
    suit_age_ns: int
    ground_age_ns: int
    group_delay_ns: int
    valid: int
    phase: int
    static_pose: int
    converged: int
    poses_used: int
    stance: int
    suggested_pose: int
    motion_samples_used: int
    sharing_source: int
    worst_joint: int
    lifts: int
    body_source: int
    foot_outline_source: int
    body_rejected: int
    unavailable: int
    acceleration_source: int
    ground_devices: int
    joint_level: ctypes.Array[ctypes.c_uint32]
    cop_measured_m: ctypes.Array[ctypes.c_double]
    cop_measured_sigma_m: ctypes.Array[ctypes.c_double]
    cop_estimated_m: ctypes.Array[ctypes.c_double]
    cop_sigma_m: ctypes.Array[ctypes.c_double]
    com_m: ctypes.Array[ctypes.c_double]
    suit_com_m: ctypes.Array[ctypes.c_double]
    ground_force_n: ctypes.Array[ctypes.c_double]
    delta_f_n: ctypes.Array[ctypes.c_double]
    delta_f_sigma_n: float
    mass_kg: float
    foot_load_fraction: ctypes.Array[ctypes.c_double]
    hand_load_fraction: ctypes.Array[ctypes.c_double]
    foot_load_fraction_sigma: float
    hand_load_fraction_sigma: float
    load_hand_distance_m: float
    lifted_mass_kg: float
    lifted_mass_sigma_kg: float
    reach_m: float
    reach_sigma_m: float
    variance_max_m2: float
    predicted_cop_sigma_m: float
    nis: float
    prior_inflation: float
    pose_mismatch_rad: float
    suit_skew_s: float
    suit_skew_sigma_s: float
    l5s1_moment_nm: float
    l5s1_moment_sigma_nm: float
    l5s1_compression_n: float
    l5s1_compression_sigma_n: float
    dose_damage: float
    dose_probability: float
    advice_direction: ctypes.Array[ctypes.c_double]
    advice_gain_nm_per_cm: float
    segment_origin_m: ctypes.Array[ctypes.c_double]
    torque_nm: ctypes.Array[ctypes.c_double]
    torque_sigma_nm: ctypes.Array[ctypes.c_double]
    torque_covariance_nm2: ctypes.Array[ctypes.c_double]
    torque_limit_nm: ctypes.Array[ctypes.c_double]
    fatigue: ctypes.Array[ctypes.c_double]
    published_ns: int

    _fields_ = [
        ("cycle", ctypes.c_uint64),
        ("time_ns", ctypes.c_uint64),
        ("suit_sample_time_ns", ctypes.c_uint64),
        ("suit_age_ns", ctypes.c_uint64),
        ("ground_age_ns", ctypes.c_uint64),
        ("group_delay_ns", ctypes.c_uint64),
        ("valid", ctypes.c_uint64),
        ("phase", ctypes.c_uint32),
        ("static_pose", ctypes.c_uint32),
        ("converged", ctypes.c_uint32),
        ("poses_used", ctypes.c_uint32),
        ("stance", ctypes.c_uint32),
        ("suggested_pose", ctypes.c_uint32),
        ("motion_samples_used", ctypes.c_uint32),
        ("sharing_source", ctypes.c_uint32),
        ("worst_joint", ctypes.c_uint32),
        ("lifts", ctypes.c_uint32),
        ("body_source", ctypes.c_uint32),
        ("foot_outline_source", ctypes.c_uint32),
        ("body_rejected", ctypes.c_uint32),
        ("unavailable", ctypes.c_uint32),
        ("acceleration_source", ctypes.c_uint32),
        ("ground_devices", ctypes.c_uint32),
        ("joint_level", ctypes.c_uint32 * 22),
        ("cop_measured_m", ctypes.c_double * 2),
        ("cop_measured_sigma_m", ctypes.c_double * 2),
        ("cop_estimated_m", ctypes.c_double * 2),
        ("cop_sigma_m", ctypes.c_double * 2),
        ("com_m", ctypes.c_double * 3),
        ("suit_com_m", ctypes.c_double * 3),
        ("ground_force_n", ctypes.c_double * 3),
        ("delta_f_n", ctypes.c_double * 3),
        ("delta_f_sigma_n", ctypes.c_double),
        ("mass_kg", ctypes.c_double),
        ("foot_load_fraction", ctypes.c_double * 2),
        ("hand_load_fraction", ctypes.c_double * 2),
        ("foot_load_fraction_sigma", ctypes.c_double),
        ("hand_load_fraction_sigma", ctypes.c_double),
        ("load_hand_distance_m", ctypes.c_double),
        ("lifted_mass_kg", ctypes.c_double),
        ("lifted_mass_sigma_kg", ctypes.c_double),
        ("reach_m", ctypes.c_double),
        ("reach_sigma_m", ctypes.c_double),
        ("variance_max_m2", ctypes.c_double),
        ("predicted_cop_sigma_m", ctypes.c_double),
        ("nis", ctypes.c_double),
        ("prior_inflation", ctypes.c_double),
        ("pose_mismatch_rad", ctypes.c_double),
        ("suit_skew_s", ctypes.c_double),
        ("suit_skew_sigma_s", ctypes.c_double),
        ("l5s1_moment_nm", ctypes.c_double),
        ("l5s1_moment_sigma_nm", ctypes.c_double),
        ("l5s1_compression_n", ctypes.c_double),
        ("l5s1_compression_sigma_n", ctypes.c_double),
        ("dose_damage", ctypes.c_double),
        ("dose_probability", ctypes.c_double),
        ("advice_direction", ctypes.c_double * 3),
        ("advice_gain_nm_per_cm", ctypes.c_double),
        ("segment_origin_m", ctypes.c_double * 69),
        ("torque_nm", ctypes.c_double * 66),
        ("torque_sigma_nm", ctypes.c_double * 22),
        ("torque_covariance_nm2", ctypes.c_double * 66),
        ("torque_limit_nm", ctypes.c_double * 22),
        ("fatigue", ctypes.c_double * 22),
        ("published_ns", ctypes.c_uint64),
    ]

    @staticmethod
    def type_name() -> str:
        """The name that iceoryx2 compares."""
        return "equipoise/State/5"


assert ctypes.sizeof(State) == 2752


class EarlyState(ctypes.Structure):
    """Result about the newest suit sample; see core/src/message/early_state.rs."""

    cycle: int
    time_ns: int
    sample_time_ns: int
    sample_age_ns: int
    valid: int
    acceleration_source: int
    calibrated: int
    com_m: ctypes.Array[ctypes.c_double]
    cop_estimated_m: ctypes.Array[ctypes.c_double]
    cop_sigma_m: ctypes.Array[ctypes.c_double]
    delta_f_n: ctypes.Array[ctypes.c_double]
    delta_f_sigma_n: float
    hand_m: ctypes.Array[ctypes.c_double]
    hand_velocity_m_per_s: ctypes.Array[ctypes.c_double]
    lifted_mass_kg: float
    lifted_mass_sigma_kg: float
    torque_nm: ctypes.Array[ctypes.c_double]
    torque_sigma_nm: ctypes.Array[ctypes.c_double]
    published_ns: int

    _fields_ = [
        ("cycle", ctypes.c_uint64),
        ("time_ns", ctypes.c_uint64),
        ("sample_time_ns", ctypes.c_uint64),
        ("sample_age_ns", ctypes.c_uint64),
        ("valid", ctypes.c_uint64),
        ("acceleration_source", ctypes.c_uint32),
        ("calibrated", ctypes.c_uint32),
        ("com_m", ctypes.c_double * 3),
        ("cop_estimated_m", ctypes.c_double * 2),
        ("cop_sigma_m", ctypes.c_double * 2),
        ("delta_f_n", ctypes.c_double * 3),
        ("delta_f_sigma_n", ctypes.c_double),
        ("hand_m", ctypes.c_double * 6),
        ("hand_velocity_m_per_s", ctypes.c_double * 6),
        ("lifted_mass_kg", ctypes.c_double),
        ("lifted_mass_sigma_kg", ctypes.c_double),
        ("torque_nm", ctypes.c_double * 66),
        ("torque_sigma_nm", ctypes.c_double * 22),
        ("published_ns", ctypes.c_uint64),
    ]

    @staticmethod
    def type_name() -> str:
        """The name that iceoryx2 compares."""
        return "equipoise/EarlyState/1"


assert ctypes.sizeof(EarlyState) == 960


class ConsumerReceipt(ctypes.Structure):
    """Latency of the states received by one consumer; see core/src/message/consumer_receipt.rs."""

    time_ns: int
    since_ns: int
    consumer: ctypes.Array[ctypes.c_uint8]
    process_id: int
    reserved: int
    states: int
    states_missed: int
    max_ns: ctypes.Array[ctypes.c_uint64]
    reserved_head: ctypes.Array[ctypes.c_uint64]
    published_to_consumer: ctypes.Array[ctypes.c_uint64]
    due_to_consumer: ctypes.Array[ctypes.c_uint64]
    suit_to_consumer: ctypes.Array[ctypes.c_uint64]

    _fields_ = [
        ("time_ns", ctypes.c_uint64),
        ("since_ns", ctypes.c_uint64),
        ("consumer", ctypes.c_uint8 * 32),
        ("process_id", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32),
        ("states", ctypes.c_uint64),
        ("states_missed", ctypes.c_uint64),
        ("max_ns", ctypes.c_uint64 * 3),
        ("reserved_head", ctypes.c_uint64 * 4),
        ("published_to_consumer", ctypes.c_uint64 * 512),
        ("due_to_consumer", ctypes.c_uint64 * 512),
        ("suit_to_consumer", ctypes.c_uint64 * 512),
    ]

    @staticmethod
    def type_name() -> str:
        """The name that iceoryx2 compares."""
        return "equipoise/ConsumerReceipt/1"


assert ctypes.sizeof(ConsumerReceipt) == 12416


class HandoverRequest(ctypes.Structure):
    """Request for the place at which a part relieves the worker; see core/src/message/handover.rs."""

    mass_kg: float
    mass_sigma_kg: float
    width_m: float
    current_m: ctypes.Array[ctypes.c_double]
    current_frame: int
    current_is_sloped: int
    current_slope_rad: float

    _fields_ = [
        ("mass_kg", ctypes.c_double),
        ("mass_sigma_kg", ctypes.c_double),
        ("width_m", ctypes.c_double),
        ("current_m", ctypes.c_double * 3),
        ("current_frame", ctypes.c_uint32),
        ("current_is_sloped", ctypes.c_uint32),
        ("current_slope_rad", ctypes.c_double),
    ]

    @staticmethod
    def type_name() -> str:
        """The name that iceoryx2 compares."""
        return "equipoise/HandoverRequest/1"


assert ctypes.sizeof(HandoverRequest) == 64


class HandoverPlan(ctypes.Structure):
    """The plan of a `HandoverRequest`; see core/src/message/handover.rs."""

    refused: int
    reserved: int
    cycle: int
    sample_time_ns: int
    valid: int
    subject: ctypes.Array[ctypes.c_uint8]
    handovers: int
    worst_joint: int
    position_m: ctypes.Array[ctypes.c_double]
    place_m: ctypes.Array[ctypes.c_double]
    limit_ratio: float
    limit_ratio_sigma: float
    current_limit_ratio: float
    current_limit_ratio_sigma: float
    current_status: int
    current_worst_joint: int
    slope_rad: float
    feet_heading_rad: float
    unused: ctypes.Array[ctypes.c_uint64]

    _fields_ = [
        ("refused", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32),
        ("cycle", ctypes.c_uint64),
        ("sample_time_ns", ctypes.c_uint64),
        ("valid", ctypes.c_uint64),
        ("subject", ctypes.c_uint8 * 64),
        ("handovers", ctypes.c_uint32),
        ("worst_joint", ctypes.c_uint32),
        ("position_m", ctypes.c_double * 3),
        ("place_m", ctypes.c_double * 3),
        ("limit_ratio", ctypes.c_double),
        ("limit_ratio_sigma", ctypes.c_double),
        ("current_limit_ratio", ctypes.c_double),
        ("current_limit_ratio_sigma", ctypes.c_double),
        ("current_status", ctypes.c_uint32),
        ("current_worst_joint", ctypes.c_uint32),
        ("slope_rad", ctypes.c_double),
        ("feet_heading_rad", ctypes.c_double),
        ("unused", ctypes.c_uint64 * 6),
    ]

    @staticmethod
    def type_name() -> str:
        """The name that iceoryx2 compares."""
        return "equipoise/HandoverPlan/2"


assert ctypes.sizeof(HandoverPlan) == 256


class Reason(Flags):
    """Invalid reasons: bits of `State.valid`."""

    SUIT_STALE = 1
    GROUND_STALE = 2
    NOT_IDENTIFIED = 4
    MOVING = 8
    FEET_OFF_PLATE = 16
    BELOW_LOAD_THRESHOLD = 32
    MODEL_CHANGED = 64
    CLOCK_UNSYNCHRONISED = 128
    LOAD_NOT_AT_HANDS = 256
    MASS_UNKNOWN = 512
    BODY_UNKNOWN = 1024
    PLATE_FAULT = 2048
    COP_NOT_MEASURED = 4096
    LOAD_BELOW_DETECTION_LIMIT = 8192
    POSITION_UNKNOWN = 16384
    GROUND_IMPLAUSIBLE = 32768
    SUIT_IMPLAUSIBLE = 65536
    WEIGHT_MISSING = 131072


INVALIDATES_GROUND_FORCE = Reason(34818)
INVALIDATES_COP_MEASURED = Reason(38930)
INVALIDATES_COM = Reason(82945)
INVALIDATES_COP_ESTIMATED = Reason(83081)
INVALIDATES_DELTA_F = Reason(106138)
INVALIDATES_RESIDUAL = Reason(122591)
INVALIDATES_LIFTED_MASS = Reason(237242)
INVALIDATES_LOW_BACK = Reason(262111)
INVALIDATES_TORQUES = Reason(262143)
INVALIDATES_POSE = Reason(65537)
INVALIDATES_SUIT_COM = Reason(82945)
INVALIDATES_LOAD_HAND_DISTANCE = Reason(261887)


class Phase(enum.IntEnum):
    """Phase of the pipeline: `State.phase`."""

    WAITING = 0
    IDENTIFYING = 1
    MONITORING = 2
    DEGRADED = 3


class Level(enum.IntEnum):
    """Overload level of a joint: `State.joint_level`."""

    NONE = 0
    GREEN = 1
    ORANGE = 2
    RED = 3
    ABOVE_MAX = 4
    UNDECIDED = 5


class Sharing(enum.IntEnum):
    """Source of `State.foot_load_fraction`: `State.sharing_source`."""

    GEOMETRY = 0
    MEASURED = 1


class Unavailable(Flags):
    """Quantities that the station's sensors do not provide: bits of `State.unavailable`."""

    SUIT_COM = 1
    SHEAR = 2


class GroundDevice(Flags):
    """Devices in the ground sample: bits of `State.ground_devices`."""

    PLATE = 1
    SECOND_PLATE = 2
    INSOLES = 4


class BodySource(enum.IntEnum):
    """Source of the segment lengths: `State.body_source`."""

    UNKNOWN = 0
    POSES = 1
    NULL_POSE = 2
    STORED = 3


class BodyRejected(enum.IntEnum):
    """Reason why the suit's null pose is not used: `State.body_rejected`."""

    NONE = 0
    IMPOSSIBLE = 1
    STALE = 2
    OTHER_CHARACTER = 3
    CONTRADICTS_POSES = 4
    CONTRADICTS_WORKER = 5


class FootOutline(enum.IntEnum):
    """Source of the foot outlines: `State.foot_outline_source`."""

    STATURE = 0
    SUIT = 1


class Acceleration(enum.IntEnum):
    """Source of the body's accelerations: `State.acceleration_source`."""

    POSITIONS = 0
    SUIT = 1


class CurrentFrame(enum.IntEnum):
    """Frame of the current place of a part: the station's world, or relative to the feet as a plan's `place_m`."""

    NONE = 0
    STATION = 1
    FEET = 2


class CurrentStatus(enum.IntEnum):
    """Prediction at the current place of a part."""

    NONE = 0
    PREDICTED = 1
    OUT_OF_REACH = 2
    OUT_OF_BALANCE = 3


class HandoverRefusal(enum.IntEnum):
    """Reason why there is no plan of a handover; see core/src/message/handover.rs."""

    NONE = 0
    REQUEST = 1
    NOT_IDENTIFIED = 2
    MASS_UNKNOWN = 3
    STALE = 4
    INVALID = 5
    INFEASIBLE = 6


class Joint(enum.IntEnum):
    """Indices of a state's arrays per joint."""

    L5S1 = 0
    L4L3 = 1
    L1T12 = 2
    T9T8 = 3
    T1C7 = 4
    C1_HEAD = 5
    RIGHT_T4_SHOULDER = 6
    RIGHT_SHOULDER = 7
    RIGHT_ELBOW = 8
    RIGHT_WRIST = 9
    LEFT_T4_SHOULDER = 10
    LEFT_SHOULDER = 11
    LEFT_ELBOW = 12
    LEFT_WRIST = 13
    RIGHT_HIP = 14
    RIGHT_KNEE = 15
    RIGHT_ANKLE = 16
    RIGHT_BALL_FOOT = 17
    LEFT_HIP = 18
    LEFT_KNEE = 19
    LEFT_ANKLE = 20
    LEFT_BALL_FOOT = 21
