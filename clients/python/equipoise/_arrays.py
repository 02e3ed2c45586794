"""A reading's numbers as NumPy arrays and pandas tables. Neither is needed for anything else."""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING, Any, Callable, Dict, Iterable, List, Optional, Tuple, Union

from . import _messages as table
from ._messages import Joint, NotGiven, Reason, State

if TYPE_CHECKING:
    import numpy
    import pandas

    from .reading import NoReading, Reading

    Array = numpy.ndarray[Any, numpy.dtype[Any]]

# What spoils which field; core/src/message/validity.rs explains. Fields that are not named are never withheld.
SPOILERS: Dict[str, Reason] = {
    "joint_level": table.SPOILS_TORQUES,
    "cop_measured_m": table.SPOILS_COP_MEASURED,
    "cop_measured_sigma_m": table.SPOILS_COP_MEASURED,
    "cop_estimated_m": table.SPOILS_COP_ESTIMATED,
    "cop_sigma_m": table.SPOILS_COP_ESTIMATED,
    "com_m": table.SPOILS_COM,
    "suit_com_m": Reason.SUIT_STALE,
    "ground_force_n": table.SPOILS_GROUND_FORCE,
    "delta_f_n": table.SPOILS_DELTA_F,
    "delta_f_sigma_n": table.SPOILS_DELTA_F,
    "mass_kg": Reason.MASS_UNKNOWN,
    "zeta": table.SPOILS_COP_MEASURED | table.SPOILS_COP_ESTIMATED,
    "zeta_sigma": table.SPOILS_COP_MEASURED | table.SPOILS_COP_ESTIMATED,
    "sharing_source": table.SPOILS_COP_MEASURED | table.SPOILS_COP_ESTIMATED,
    "acceleration_source": table.SPOILS_COM,
    "ground_devices": table.SPOILS_GROUND_FORCE,
    "pose_mismatch_rad": Reason.SUIT_STALE,
    "eta": table.SPOILS_TORQUES,
    "eta_sigma": table.SPOILS_TORQUES,
    "load_distance_m": table.SPOILS_TORQUES,
    "lifted_mass_kg": table.SPOILS_LIFTED_MASS,
    "lifted_mass_sigma_kg": table.SPOILS_LIFTED_MASS,
    "reach_m": table.SPOILS_TORQUES,
    "reach_sigma_m": table.SPOILS_TORQUES,
    "worst_joint": table.SPOILS_TORQUES,
    "l5s1_moment_nm": table.SPOILS_BACK,
    "l5s1_moment_sigma_nm": table.SPOILS_BACK,
    "l5s1_compression_n": table.SPOILS_BACK,
    "l5s1_compression_sigma_n": table.SPOILS_BACK,
    "advice_direction": table.SPOILS_TORQUES,
    "advice_gain_nm_per_cm": table.SPOILS_TORQUES,
    "segment_origin_m": Reason.SUIT_STALE,
    "torque_nm": table.SPOILS_TORQUES,
    "torque_sigma_nm": table.SPOILS_TORQUES,
    "torque_covariance_nm2": table.SPOILS_TORQUES,
    "torque_limit_nm": table.SPOILS_TORQUES,
}

UNKNOWN = 2**64 - 1
NO_POSE = 2**32 - 1


def _advises(state: State) -> bool:
    return any(state.advice_direction)


def _asks_a_pose(state: State) -> bool:
    return state.suggested_pose != NO_POSE


# Where a state says the field at all, as in view/src/state_json.rs. Fields that are not named it always says.
SAID_WHERE: Dict[str, Callable[[State], bool]] = {
    "suit_com_m": lambda state: not state.not_given & NotGiven.SUIT_COM,
    # Without shear its vertical part alone is a number: `Reading.ground_force_up_n`.
    "ground_force_n": lambda state: not state.not_given & NotGiven.SHEAR,
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
    """Whether a field's value may be used: no reason that invalidates it is raised, and the station provides it."""
    is_said = SAID_WHERE.get(name)
    return not state.valid & SPOILERS.get(name, 0) and (is_said is None or is_said(state))


def view(state: State, name: str) -> Optional[Array]:
    """A field's own bytes as an array, without a copy; None while its value must not be used."""
    import numpy

    if not is_valid(state, name):
        return None
    place: Any = getattr(State, name)
    is_one = not isinstance(getattr(state, name), ctypes.Array)
    declared = _field_types()[name]
    number = declared if is_one else declared._type_
    kind = numpy.dtype(number)
    memory: Any = state  # NumPy takes any buffer; its types do not know ctypes'.
    array: Array = numpy.frombuffer(memory, dtype=kind, count=place.size // kind.itemsize, offset=place.offset)
    array = array.reshape(SHAPES.get(name, array.shape))
    array.flags.writeable = False
    return array


def _row(reading: Reading) -> Dict[str, Union[int, float, str, bool, None]]:
    state = reading.state
    row: Dict[str, Union[int, float, str, bool, None]] = {
        "time_ns": state.time_ns,
        "moment_time_ns": state.suit_sample_time_ns or None,
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
        "load_distance_m",
        "l5s1_moment_nm",
        "l5s1_compression_n",
        "dose_damage",
        "dose_probability",
    ):
        row[name] = getattr(state, name) if is_valid(state, name) else None
    torques, torques_valid = state.torque_nm, not state.valid & table.SPOILS_TORQUES
    for joint in Joint:
        name = joint.name.lower()
        x, y, z = torques[3 * joint : 3 * joint + 3]
        row[f"torque_{name}_nm"] = (x * x + y * y + z * z) ** 0.5 if torques_valid else None
        row[f"sigma_{name}_nm"] = state.torque_sigma_nm[joint] if torques_valid else None
        row[f"level_{name}"] = table.Level(state.joint_level[joint]).name.lower() if torques_valid else None
        row[f"fatigue_{name}"] = state.fatigue[joint]
    return row


def to_pandas(readings: Iterable[Union[Reading, NoReading]]) -> pandas.DataFrame:
    """One row for each reading, by the time of its state; what is withheld is missing (pandas' NaN or None).

    Torques are magnitudes. A `NoReading` has no time, and no row: look at `cycle` and `missed` for gaps.
    """
    import pandas

    from .reading import Reading

    rows: List[Dict[str, Union[int, float, str, bool, None]]] = [_row(one) for one in readings if isinstance(one, Reading)]
    frame = pandas.DataFrame(rows)
    return frame.set_index("time_ns") if rows else frame
