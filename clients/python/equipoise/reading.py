"""What a consumer is handed: a state that is current, or the reason why there is none."""

from __future__ import annotations

import enum
from typing import TYPE_CHECKING, List, NamedTuple, Optional, Tuple

from ._arrays import view
from ._messages import SPOILS_GROUND_FORCE, SPOILS_TORQUES, Joint, Reason, State

if TYPE_CHECKING:
    from ._arrays import Array


class Reading(NamedTuple):
    """A state that is current, with what a controller must know about it. Is true."""

    state: State
    """The state. Look at `reasons` before using a value of it."""
    picked_up_ns: int
    """When it was picked up, CLOCK_MONOTONIC."""
    age_ns: int
    """How long ago its cycle was due, when it was handed out."""
    moment_age_ns: Optional[int]
    """How old the moment is that torques, forces and centres are about; None before the first."""
    missed: int
    """States since the last new one that were not handed out: overwritten before they were read, or too old."""
    restarted: bool
    """The daemon was restarted between the last new state and this one."""
    is_new: bool
    """Whether it was not handed out before; only `Consumer.latest` hands one out again."""

    def __bool__(self) -> bool:
        return True

    @property
    def reasons(self) -> Reason:
        """Why values of the state must not be used."""
        return Reason(self.state.valid)

    @property
    def reason_names(self) -> List[str]:
        """The public names of `reasons`, lowest bit first."""
        return [(reason.name or "").lower() for reason in Reason if self.state.valid & reason]

    def invalidated_by(self, reasons: Reason) -> bool:
        """Whether one of `reasons` is raised: then the value that they invalidate is 0 and has no meaning."""
        return bool(self.state.valid & reasons)

    def torque_nm(self, joint: Joint) -> Optional[Tuple[float, float, float]]:
        """The overload torque of a joint, world axes, N m; None while it must not be used."""
        if self.invalidated_by(SPOILS_TORQUES):
            return None
        x, y, z = self.state.torque_nm[3 * joint : 3 * joint + 3]
        return (x, y, z)

    @property
    def ground_force_up_n(self) -> Optional[float]:
        """The vertical ground reaction on the person, N; given without shear, too. None while it must not be used."""
        if self.invalidated_by(SPOILS_GROUND_FORCE):
            return None
        return float(self.state.ground_force_n[2])

    def array(self, name: str) -> Optional[Array]:
        """A field of the state as a NumPy array on the state's own memory; None while it must not be used.

        That is while a reason invalidates it, and where the station's sensors do not provide it (`State.not_given`). A force
        without shear is no vector: then `ground_force_n` is None, and `ground_force_up_n` a number.
        `torque_nm` has a row for each joint, `segment_origin_m` one for each segment. It cannot be written to.
        """
        return view(self.state, name)


class Why(enum.Enum):
    """Why there is no current state."""

    SILENT = "silent"
    """No new state came: the daemon is not running, or hangs."""
    STALE = "stale"
    """States came, but all too late."""
    OTHER_CLOCK = "other_clock"
    """The daemon's CLOCK_MONOTONIC is another one."""
    BUS = "bus"
    """The bus cannot be read; the consumer rejoins by itself."""


class NoReading(NamedTuple):
    """Why there is no current state. Is false, and has no state."""

    why: Why
    text: str
    """A sentence for people."""

    def __bool__(self) -> bool:
        return False

    def __str__(self) -> str:
        return self.text
