"""Result of reading: a current state, or the reason why there is none."""

from __future__ import annotations

import enum
from typing import TYPE_CHECKING, List, NamedTuple, Optional, Tuple, Union

from ._arrays import view
from ._messages import INVALIDATES_GROUND_FORCE, INVALIDATES_TORQUES, EarlyState, Joint, Level, Phase, Reason, State
from ._names import joint_name, joint_of

if TYPE_CHECKING:
    from ._arrays import Array


class EarlyReading(NamedTuple):
    """A current early state, with its age: the result about the newest suit sample. Its truth value is true."""

    early: EarlyState
    """The early state. Check `reasons` before using its values."""
    received_ns: int
    """Time of receipt, CLOCK_MONOTONIC ns."""
    age_ns: int
    """Time from the cycle's due time to the return of this reading, ns."""
    sample_age_ns: int
    """Time from `early.sample_time_ns` to the return of this reading, ns."""
    is_new: bool
    """Whether it was not returned before."""

    def __bool__(self) -> bool:
        return True

    @property
    def reasons(self) -> Reason:
        """The invalid reasons of the early state; they print as their names."""
        return Reason(self.early.valid)

    def invalidated_by(self, reasons: Reason) -> bool:
        """Whether one of `reasons` is raised; the value that they invalidate is then 0."""
        return bool(self.early.valid & reasons)

    def torque_nm(self, joint: Union[Joint, str]) -> Optional[Tuple[float, float, float]]:
        """The overload torque of a joint, world axes, N m; None while it is invalid."""
        joint = joint_of(joint)
        if self.invalidated_by(INVALIDATES_TORQUES):
            return None
        x, y, z = self.early.torque_nm[3 * joint : 3 * joint + 3]
        return (x, y, z)


class Reading(NamedTuple):
    """A current state, with its age. Its truth value is true."""

    state: State
    """The state. Check `reasons` before using its values."""
    received_ns: int
    """Time of receipt, CLOCK_MONOTONIC ns."""
    age_ns: int
    """Time from the cycle's due time to the return of this reading, ns."""
    sample_age_ns: Optional[int]
    """Time from `state.suit_sample_time_ns`, which torques, forces and centres refer to, to the return of this reading, ns;
    None before the first sample."""
    missed: int
    """States since the last new one that were not returned: overwritten before they were read, or too old."""
    restarted: bool
    """The daemon was restarted between the last new state and this one."""
    is_new: bool
    """Whether it was not returned before; only `Consumer.latest` returns a state again."""

    def __bool__(self) -> bool:
        return True

    def __repr__(self) -> str:
        state = self.state
        if self.invalidated_by(INVALIDATES_TORQUES):
            torque = f"no torques: {self.reasons}"
        else:
            at = state.worst_joint
            x, y, z = state.torque_nm[3 * at : 3 * at + 3]
            torque = (
                f"{joint_name(Joint(at))} {(x * x + y * y + z * z) ** 0.5:.1f} ± {state.torque_sigma_nm[at]:.1f} N m "
                f"of {state.torque_limit_nm[at]:.0f}, {Level(state.joint_level[at]).name.lower()}"
            )
        phase = Phase(state.phase).name.lower()
        return f"<Reading: cycle {state.cycle}, {phase}, {self.age_ns / 1e6:.1f} ms old; {torque}>"

    @property
    def reasons(self) -> Reason:
        """The invalid reasons of the state; they print as their names."""
        return Reason(self.state.valid)

    @property
    def reason_names(self) -> List[str]:
        """Public names of `reasons`, lowest bit first."""
        return self.reasons.names

    def invalidated_by(self, reasons: Reason) -> bool:
        """Whether one of `reasons` is raised; the value that they invalidate is then 0."""
        return bool(self.state.valid & reasons)

    def torque_nm(self, joint: Union[Joint, str]) -> Optional[Tuple[float, float, float]]:
        """The overload torque of a joint, world axes, N m; None while it is invalid. A name: `RightKnee`, `right knee`."""
        joint = joint_of(joint)
        if self.invalidated_by(INVALIDATES_TORQUES):
            return None
        x, y, z = self.state.torque_nm[3 * joint : 3 * joint + 3]
        return (x, y, z)

    @property
    def ground_force_up_n(self) -> Optional[float]:
        """Vertical ground reaction on the person, N; available without shear, too. None while it is invalid."""
        if self.invalidated_by(INVALIDATES_GROUND_FORCE):
            return None
        return float(self.state.ground_force_n[2])

    def array(self, name: str) -> Optional[Array]:
        """A field of the state as a NumPy array on the state's own memory; None while it is invalid.

        That is while a reason invalidates it, and if the station's sensors do not provide it (`State.unavailable`). Without
        shear `ground_force_n` is None, and `ground_force_up_n` is available.
        `torque_nm` has a row for each joint, `segment_origin_m` one for each segment. It is read-only.
        """
        return view(self.state, name)


class NoStateReason(enum.Enum):
    """Reason why there is no current state."""

    SILENT = "silent"
    """No new state arrived: the daemon is not running, or hangs."""
    STALE = "stale"
    """States arrived, but all were too old."""
    OTHER_CLOCK = "other_clock"
    """The daemon has another CLOCK_MONOTONIC."""
    BUS = "bus"
    """The bus cannot be read; the consumer rejoins by itself, and returns this until then."""


class NoReading(NamedTuple):
    """Reason why there is no current state. Its truth value is false."""

    reason: NoStateReason
    text: str
    """The reason as a sentence."""

    def __bool__(self) -> bool:
        return False

    def __str__(self) -> str:
        return self.text

    def __repr__(self) -> str:
        return f"<NoReading: {self.text}>"
