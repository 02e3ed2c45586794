"""A reading's numbers as NumPy arrays and pandas tables. Neither is needed for anything else."""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING, Any, Callable, Dict, Iterable, List, Optional, Tuple, Union

from . import _messages as table
from ._messages import Joint, Unavailable, Reason, State

if TYPE_CHECKING:
    import numpy
    import pandas

    from .reading import NoReading, Reading

    Array = numpy.ndarray[Any, numpy.dtype[Any]]

# Flags that invalidate each field (core/src/message/validity.rs). Other fields are always valid.
INVALIDATED_BY: Dict[str, Reason] = {
    "joint_level": table.INVALIDATES_TORQUES,
    "cop_measured_m": table.INVALIDATES_COP_MEASURED,
    "cop_measured_sigma_m": table.INVALIDATES_COP_MEASURED,
    "cop_estimated_m": table.INVALIDATES_COP_ESTIMATED,
    "cop_sigma_m": table.INVALIDATES_COP_ESTIMATED,
    "com_m": table.INVALIDATES_COM,
    "suit_com_m": table.INVALIDATES_SUIT_COM,
    "ground_force_n": table.INVALIDATES_GROUND_FORCE,
    "delta_f_n": table.INVALIDATES_DELTA_F,
    "delta_f_sigma_n": table.INVALIDATES_DELTA_F,
    "mass_kg": Reason.MASS_UNKNOWN,
    "foot_load_fraction": table.INVALIDATES_TORQUES,
    "foot_load_fraction_sigma": table.INVALIDATES_TORQUES,
    "sharing_source": table.INVALIDATES_TORQUES,
    "acceleration_source": table.INVALIDATES_COM,
    "ground_devices": table.INVALIDATES_GROUND_FORCE,
    "pose_mismatch_rad": Reason.SUIT_STALE | Reason.SUIT_IMPLAUSIBLE,
    "hand_load_fraction": table.INVALIDATES_TORQUES,
    "hand_load_fraction_sigma": table.INVALIDATES_TORQUES,
    "load_hand_distance_m": Reason(table.INVALIDATES_TORQUES & ~Reason.LOAD_NOT_AT_HANDS),
    "lifted_mass_kg": table.INVALIDATES_LIFTED_MASS,
    "lifted_mass_sigma_kg": table.INVALIDATES_LIFTED_MASS,
    "reach_m": table.INVALIDATES_TORQUES,
    "reach_sigma_m": table.INVALIDATES_TORQUES,
    "worst_joint": table.INVALIDATES_TORQUES,
    "l5s1_moment_nm": table.INVALIDATES_LOW_BACK,
    "l5s1_moment_sigma_nm": table.INVALIDATES_LOW_BACK,
    "l5s1_compression_n": table.INVALIDATES_LOW_BACK,
    "l5s1_compression_sigma_n": table.INVALIDATES_LOW_BACK,
    "advice_direction": table.INVALIDATES_TORQUES,
    "advice_gain_nm_per_cm": table.INVALIDATES_TORQUES,
    "segment_origin_m": Reason.SUIT_STALE | Reason.SUIT_IMPLAUSIBLE,
    "torque_nm": table.INVALIDATES_TORQUES,
    "torque_sigma_nm": table.INVALIDATES_TORQUES,
    "torque_covariance_nm2": table.INVALIDATES_TORQUES,
    "torque_limit_nm": table.INVALIDATES_TORQUES,
}

UNKNOWN = 2**64 - 1
NO_POSE = 2**32 - 1


def _advises(state: State) -> bool:
    return any(state.advice_direction)


def _asks_a_pose(state: State) -> bool:
    return state.suggested_pose != NO_POSE


# Condition under which a field is available, as in view/src/state_json.rs. Other fields are always available.
AVAILABLE_IF: Dict[str, Callable[[State], bool]] = {
    "suit_com_m": lambda state: not state.unavailable & Unavailable.SUIT_COM,
    # Without shear only the vertical component is available: `Reading.ground_force_up_n`.
    "ground_force_n": lambda state: not state.unavailable & Unavailable.SHEAR,
    "suit_sample_time_ns": lambda state: state.suit_sample_time_ns != 0,
    "suit_age_ns": lambda state: state.suit_sample_time_ns != 0,
    "ground_age_ns": lambda state: state.ground_age_ns != UNKNOWN,
    "suggested_pose": _asks_a_pose,
    "pose_mismatch_rad": _asks_a_pose,
    "advice_direction": _advises,
    "advice_gain_nm_per_cm": _advises,
    "cop_measured_sigma_m": lambda state: min(state.cop_measured_sigma_m) > 0.0,
    "delta_f_sigma_n": lambda state: state.delta_f_sigma_n > 0.0,
    "variance_max_m2": lambda state: state.variance_max_m2 > 0.0,
    "predicted_cop_sigma_m": lambda state: state.predicted_cop_sigma_m > 0.0,
    "nis": lambda state: state.nis > 0.0,
    "prior_inflation": lambda state: state.prior_inflation > 0.0,
    "suit_skew_s": lambda state: state.suit_skew_sigma_s > 0.0,
    "suit_skew_sigma_s": lambda state: state.suit_skew_sigma_s > 0.0,
}

SHAPES: Dict[str, Tuple[int, int]] = {
    "torque_nm": (table.JOINTS, 3),
    "segment_origin_m": (table.SEGMENTS, 3),
}


def _field_types() -> Dict[str, Any]:
    return {field[0]: field[1] for field in State._fields_}


def is_valid(state: State, name: str) -> bool:
    """Whether a field is valid: no reason that invalidates it is raised, and the station provides it."""
    is_available = AVAILABLE_IF.get(name)
    return not state.valid & INVALIDATED_BY.get(name, 0) and (is_available is None or is_available(state))


def view(state: State, name: str) -> Optional[Array]:
    """A field's own bytes as an array, without a copy; None while it is invalid."""
    import numpy

    if not is_valid(state, name):
        return None
    place: Any = getattr(State, name)
    is_one = not isinstance(getattr(state, name), ctypes.Array)
    declared = _field_types()[name]
    number = declared if is_one else declared._type_
    kind = numpy.dtype(number)
    memory: Any = state  # NumPy accepts any buffer, but its type hints exclude ctypes.
    array: Array = numpy.frombuffer(memory, dtype=kind, count=place.size // kind.itemsize, offset=place.offset)
    array = array.reshape(SHAPES.get(name, array.shape))
    array.flags.writeable = False
    return array


def _row(reading: Reading) -> Dict[str, Union[int, float, str, bool, None]]:
    state = reading.state
    row: Dict[str, Union[int, float, str, bool, None]] = {
        "time_ns": state.time_ns,
        "sample_time_ns": state.suit_sample_time_ns or None,
        "cycle": state.cycle,
        "age_ns": reading.age_ns,
        "missed": reading.missed,
        "restarted": reading.restarted,
        "phase": table.Phase(state.phase).name.lower(),
        "reasons": "+".join(reading.reason_names),
    }
    for name in (
        "delta_f_sigma_n",
        "lifted_mass_kg",
        "lifted_mass_sigma_kg",
        "reach_m",
        "load_hand_distance_m",
        "l5s1_moment_nm",
        "l5s1_compression_n",
        "dose_damage",
        "dose_probability",
    ):
        row[name] = getattr(state, name) if is_valid(state, name) else None
    torques, torques_valid = state.torque_nm, not state.valid & table.INVALIDATES_TORQUES
    for joint in Joint:
        name = joint.name.lower()
        x, y, z = torques[3 * joint : 3 * joint + 3]
        row[f"torque_{name}_nm"] = (x * x + y * y + z * z) ** 0.5 if torques_valid else None
        row[f"sigma_{name}_nm"] = state.torque_sigma_nm[joint] if torques_valid else None
        row[f"level_{name}"] = table.Level(state.joint_level[joint]).name.lower() if torques_valid else None
        row[f"fatigue_{name}"] = state.fatigue[joint]
    return row


def to_pandas(readings: Iterable[Union[Reading, NoReading]]) -> pandas.DataFrame:
    """One row per reading, by the time of its state; invalid values are missing (pandas' NaN or None).

    Torques are magnitudes. A `NoReading` has no time, and no row: `cycle` and `missed` show gaps.
    """
    import pandas

    from .reading import Reading

    rows: List[Dict[str, Union[int, float, str, bool, None]]] = [_row(one) for one in readings if isinstance(one, Reading)]
    frame = pandas.DataFrame(rows)
    return frame.set_index("time_ns") if rows else frame
