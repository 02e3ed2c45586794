"""Plans of handovers from the daemon: the place of a part in front of the worker; cli/src/client.rs does the same."""

from __future__ import annotations

import contextlib
import ctypes
import os
import time
from types import TracebackType
from typing import Any, Callable, Iterable, NamedTuple, Optional, Sequence, Tuple, Type, Union

from . import _messages as table
from ._bus import Bus, BusError, root_of_environment
from ._messages import CurrentFrame, CurrentStatus, HandoverRefusal, HandoverRequest, Joint, Reason
from ._names import joint_name

TIMEOUT_S = 2.0
"""Timeout of the daemon's response, as of the program `equipoise`, s."""
# Polling interval for the response.
POLL_INTERVAL_S = 0.001
# How long joining waits for a slot: the daemon releases those of dead processes meanwhile.
PATIENCE_S = 2.5
PLAN_BYTES = ctypes.sizeof(table.HandoverPlan)

Position = Tuple[float, float, float]


class HandoverPlan(NamedTuple):
    """The best place of a part: of the middle between the grips. Its truth value is true.

    A limit ratio is the predicted overload of the worst joint over its τ_max.
    """

    subject: str
    """Pseudonym of the worker."""
    cycle: int
    """Cycle of the state with the feet and the fatigue of the plan."""
    sample_time_ns: int
    """Sample time of that state, CLOCK_MONOTONIC ns."""
    handovers: int
    """Number of measured handovers that correct the prediction."""
    position_m: Position
    """Best place, station's world, m."""
    place_m: Position
    """Best place relative to the feet: forward and to the left of the middle between the ankles, above the floor, m."""
    worst_joint: Joint
    """Worst joint at the best place."""
    limit_ratio: float
    """Limit ratio at the best place."""
    limit_ratio_sigma: float
    """1-σ of `limit_ratio`."""
    current_status: CurrentStatus
    """What is predicted at the current place; unless it is PREDICTED, the next three are None."""
    current_worst_joint: Optional[Joint]
    """Worst joint at the current place."""
    current_limit_ratio: Optional[float]
    """Limit ratio at the current place."""
    current_limit_ratio_sigma: Optional[float]
    """1-σ of `current_limit_ratio`."""
    slope_rad: float
    """Slope of the handles at the best place: how far hands that follow them point below the horizontal, rad."""
    feet_heading_rad: float
    """Heading of the feet: angle from the station's X axis about the vertical, rad. The handles slope about the worker's
    lateral axis, which is the station's Y axis turned by this."""

    def __bool__(self) -> bool:
        return True

    def __repr__(self) -> str:
        x, y, z = self.position_m
        return (
            f"<HandoverPlan: {x:.2f}, {y:.2f}, {z:.2f} m, {joint_name(self.worst_joint)} {self.limit_ratio:.2f} ± "
            f"{self.limit_ratio_sigma:.2f} of its limit; {self.subject}, cycle {self.cycle}>"
        )


class NoPlan(NamedTuple):
    """Reason why the daemon has no plan. Its truth value is false."""

    reason: HandoverRefusal
    text: str
    """The reason as a sentence."""
    subject: str
    """Pseudonym of the worker; empty if there is none."""
    reasons: Reason
    """Invalid reasons of the newest state."""

    def __bool__(self) -> bool:
        return False

    def __str__(self) -> str:
        return self.text

    def __repr__(self) -> str:
        return f"<NoPlan: {self.text}>"


class HandoverPlanner:
    """Requests plans from the daemon of a station. Belongs to the thread that made it.

    Without a station it is that of EQUIPOISE_STATION, else `station-1`; `name` is the role on the bus.
    """

    def __init__(
        self,
        station: Optional[str] = None,
        *,
        name: Optional[str] = None,
        root: Optional[str] = None,
        timeout_s: float = TIMEOUT_S,
    ) -> None:
        station = station or os.environ.get("EQUIPOISE_STATION") or "station-1"
        self._where = (station, name or f"plan-{os.getpid()}", root or root_of_environment())
        self._timeout_s = timeout_s
        self._bus: Optional[Bus] = None
        self._client: Optional[Any] = None
        self._closed = False
        self._join()

    def plan(
        self,
        *,
        mass_kg: float,
        mass_sigma_kg: float = 0.0,
        width_m: float = 0.35,
        current_m: Optional[Sequence[float]] = None,
        frame: Optional[CurrentFrame] = None,
        current_slope_rad: Optional[float] = None,
    ) -> Union[HandoverPlan, NoPlan]:
        """The place at which the part relieves the worker who stands at the station now.

        `width_m` is the distance between the grips. `current_m` is where the part is handed over now, in `frame`, with
        the slope of the handles `current_slope_rad` (None: handles that turn with the hands): the limit ratio there is
        predicted, too. Without a running daemon, or without its response within `timeout_s`, it raises a
        `BusError`; the next call joins the bus again.
        """
        if self._closed:
            raise BusError("this planner is closed: make another one")
        request = HandoverRequest(mass_kg=mass_kg, mass_sigma_kg=mass_sigma_kg, width_m=width_m)
        if (current_m is None) != (not frame):
            raise ValueError("give current_m and its frame, CurrentFrame.STATION or CurrentFrame.FEET, or neither")
        if current_m is not None and frame:
            request.current_m[:] = [float(metres) for metres in current_m]
            request.current_frame = frame
            if current_slope_rad is not None:
                request.current_is_sloped, request.current_slope_rad = 1, current_slope_rad
        try:
            return _result(self._ask(request), self._join().full_name(table.HANDOVER.suffix))
        except BusError:
            self._leave()
            raise

    def close(self) -> None:
        """Leaves the station. Later requests raise a `BusError`."""
        self._closed = True
        self._leave()

    def __del__(self) -> None:
        with contextlib.suppress(Exception):
            self._leave()

    def __enter__(self) -> HandoverPlanner:
        return self

    def __exit__(
        self, kind: Optional[Type[BaseException]], error: Optional[BaseException], trace: Optional[TracebackType]
    ) -> None:
        self.close()

    def _join(self) -> Bus:
        if self._bus is None:
            bus = Bus(*self._where, PATIENCE_S)
            try:
                self._client = bus.client(HandoverRequest, table.HandoverPlan, table.HANDOVER)
            except BusError:
                bus.close()
                raise
            self._bus = bus
        return self._bus

    def _leave(self) -> None:
        """Removes the port before the node that it depends on."""
        if self._client is not None:
            self._client.delete()
            self._client = None
        if self._bus is not None:
            self._bus.close()
            self._bus = None

    def _ask(self, request: HandoverRequest) -> table.HandoverPlan:
        service = self._join().full_name(table.HANDOVER.suffix)
        end_s = time.monotonic() + self._timeout_s
        pending = _checked(f"ask on {service}", lambda: self._client.send_copy(request))  # type: ignore[union-attr]
        try:
            if pending.number_of_server_connections == 0:
                raise BusError(f"no answer on {service}: no daemon runs on this station; start `equipoise run`")
            while True:
                response = _checked(f"read the answer on {service}", pending.receive)
                if response is not None:
                    plan = table.HandoverPlan()
                    ctypes.memmove(ctypes.addressof(plan), response.payload_ptr, PLAN_BYTES)
                    response.delete()
                    return plan
                if time.monotonic() >= end_s:
                    raise BusError(
                        f"the daemon did not answer on {service} within {1000 * self._timeout_s:.0f} ms; it may be hung or "
                        "busy, so ask its status"
                    )
                time.sleep(POLL_INTERVAL_S)
        finally:
            # The daemon does not execute a request without a client.
            pending.delete()


def _checked(what: str, call: Callable[[], Any]) -> Any:
    try:
        return call()
    except Exception as cause:
        raise BusError(f"cannot {what}: {cause}; if it persists, restart the processes of this station") from cause


def _result(plan: table.HandoverPlan, service: str) -> Union[HandoverPlan, NoPlan]:
    subject = bytes(plan.subject).split(b"\0")[0].decode(errors="replace")
    try:
        refusal = HandoverRefusal(plan.refused)
        if refusal:
            reasons = Reason(plan.valid)
            return NoPlan(refusal, _sentence(refusal, reasons, subject), subject, reasons)
        status = CurrentStatus(plan.current_status)
        is_predicted = status is CurrentStatus.PREDICTED
        return HandoverPlan(
            subject,
            plan.cycle,
            plan.sample_time_ns,
            plan.handovers,
            _position(plan.position_m),
            _position(plan.place_m),
            Joint(plan.worst_joint),
            plan.limit_ratio,
            plan.limit_ratio_sigma,
            status,
            Joint(plan.current_worst_joint) if is_predicted else None,
            plan.current_limit_ratio if is_predicted else None,
            plan.current_limit_ratio_sigma if is_predicted else None,
            plan.slope_rad,
            plan.feet_heading_rad,
        )
    except ValueError as cause:
        raise BusError(f"the response on {service} has an unknown number: {cause}; run the same release everywhere") from cause


def _position(metres: Iterable[float]) -> Position:
    x, y, z = metres
    return (x, y, z)


def _sentence(refusal: HandoverRefusal, reasons: Reason, subject: str) -> str:
    subject = subject or "the worker"
    if refusal is HandoverRefusal.NOT_IDENTIFIED:
        return f"{subject} is not identified yet; see `equipoise identify`"
    if refusal is HandoverRefusal.MASS_UNKNOWN:
        return f"the mass of {subject} is unavailable; let the plate weigh the worker, or set subject.mass_kg"
    if refusal is HandoverRefusal.STALE:
        return "the daemon has no state newer than 50 ms; see `equipoise status`"
    if refusal is HandoverRefusal.INVALID:
        return f"the position of the worker's feet is not available: {reasons}; see `equipoise status`"
    if refusal is HandoverRefusal.INFEASIBLE:
        return f"{subject} can hold the part nowhere in reach: reduce its mass or the distance between the grips"
    (lightest_kg, heaviest_kg), (narrowest_m, widest_m) = table.HANDOVER_MASS_KG, table.HANDOVER_WIDTH_M
    return (
        f"a number of the request is out of range: mass_kg {lightest_kg:g} to {heaviest_kg:g}, mass_sigma_kg 0 to mass_kg, "
        f"width_m {narrowest_m:g} to {widest_m:g}, current_m up to {table.HANDOVER_PLACE_MAX_M:g} m from the feet"
    )


def plan_handover(
    station: Optional[str] = None,
    *,
    mass_kg: float,
    mass_sigma_kg: float = 0.0,
    width_m: float = 0.35,
    current_m: Optional[Sequence[float]] = None,
    frame: Optional[CurrentFrame] = None,
    current_slope_rad: Optional[float] = None,
    name: Optional[str] = None,
    root: Optional[str] = None,
    timeout_s: float = TIMEOUT_S,
) -> Union[HandoverPlan, NoPlan]:
    """Joins, requests one plan, and leaves; see `HandoverPlanner.plan`. For repeated requests keep a `HandoverPlanner`."""
    with HandoverPlanner(station, name=name, root=root, timeout_s=timeout_s) as planner:
        return planner.plan(
            mass_kg=mass_kg, mass_sigma_kg=mass_sigma_kg, width_m=width_m, current_m=current_m, frame=frame,
            current_slope_rad=current_slope_rad,
        )
