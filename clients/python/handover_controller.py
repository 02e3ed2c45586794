"""Controller of a handover: reads the worker's state, decides (handover.py), and commands a cobot that runs
clients/ur/handover.script, by RTDE. docs/cobot.md. Not a safety function.

    pip install ./clients/python
    python clients/python/handover_controller.py station-1 192.0.2.20:30004 --mass 6

The daemon plans for a part of 6 kg; `--plan FILE` reads plans from a file instead.
"""

from __future__ import annotations

import argparse
import math
import queue
import signal
import socket
import sys
import threading
import time
from typing import List, Optional, Protocol, Tuple

import equipoise
from equipoise import (
    BusError, CurrentFrame, CurrentStatus, HandoverPlan, HandoverPlanner, HandoverRefusal, Level, NoPlan, NoReading,
    NoStateReason, Reading,
)
from handover import MODEL_CHANGED, STATE_GAP_MAX_S, Command, Decision, Input, Plan, Position
from handover_plans import Plans
from handover_rtde import Cobot

TIMEOUT_S = 0.025
SEND_EVERY_S = 0.008
# A plan of the daemon is valid for so many intervals of the requests, each of a second at least.
PLAN_INTERVALS_MAX = 3
# The worker has turned away from the handles of the target by more than this, rad: 20°.
TURNED_AWAY_RAD = math.radians(20.0)
PRINT_EVERY_S = 1.0
# Pause while the bus cannot be read: the consumer may return at once.
BUS_PAUSE_S = 0.01
SAMPLES_MAX = 1 << 16


class DaemonPlans:
    """The newest plan of the daemon, requested at an interval by a thread: a response takes longer than a decision may."""

    def __init__(self, station: str, mass_kg: float, width_m: float, interval_s: float) -> None:
        if not 0.0 < interval_s <= threading.TIMEOUT_MAX:
            raise ValueError("--interval: give a positive number of seconds")
        self._station, self._mass_kg, self._width_m, self._interval_s = station, mass_kg, width_m, interval_s
        # With each response the target of its request.
        self._responses: queue.SimpleQueue[Tuple[Optional[Position], HandoverPlan | NoPlan]] = queue.SimpleQueue()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._request, daemon=True)
        self._subject: Optional[str] = None
        self._changed_ns = self._generation = 0
        self._state_ns: Optional[int] = None
        self._sample_ns = 0
        self._is_outdated = False
        self._target: Optional[Plan] = None
        self.newest: Optional[Plan] = None
        self._thread.start()

    def ingest(self, reading: Reading, target: Optional[Plan] = None) -> bool:
        """Takes the responses; returns whether earlier plans must be discarded.

        They must if the worker may have changed (restart, `model_changed`, gap between two states), has walked or turned
        away, no place is feasible, or plans are missing. `target` is the plan that is the target now.
        """
        must_discard = False
        self._target = target
        state_ns = reading.state.time_ns
        is_gap = self._state_ns is not None and state_ns - self._state_ns >= 1e9 * STATE_GAP_MAX_S
        self._state_ns = state_ns
        if reading.restarted or reading.state.valid & MODEL_CHANGED or is_gap:
            self._changed_ns, self._subject, self._is_outdated = state_ns, None, False
            must_discard = True
        while not self._responses.empty():
            requested_m, plan = self._responses.get()
            if isinstance(plan, NoPlan):
                must_discard |= plan.reason is HandoverRefusal.INFEASIBLE
                continue
            if why_unusable(plan):
                continue
            if plan.sample_time_ns <= self._changed_ns:
                continue  # Requested before the change.
            is_of_target = target is not None and requested_m == target.at_m
            # Two successive responses: one may be a noisy measurement of the feet.
            is_worse = is_of_target and (is_outdated(plan) or has_turned_away(plan, target))
            was_outdated, self._is_outdated = self._is_outdated, is_worse
            has_moved = is_of_target and (is_out_of_reach(plan) or (was_outdated and self._is_outdated))
            if has_moved or self._subject not in (None, plan.subject):
                # The worker walked or turned away, or the state with the change was missed. The next plan is used.
                self._changed_ns, must_discard = plan.sample_time_ns, True
            else:
                self._generation += 1
                self._sample_ns = plan.sample_time_ns
                self.newest = Plan(
                    self._generation, plan.position_m, plan.limit_ratio, plan.limit_ratio_sigma, plan.slope_rad,
                    plan.feet_heading_rad,
                )
            self._subject = plan.subject
        age_max_ns = 1e9 * PLAN_INTERVALS_MAX * max(self._interval_s, 1.0)
        if must_discard or (self.newest and state_ns - self._sample_ns >= age_max_ns):
            self.newest, self._is_outdated, must_discard = None, False, True
        return must_discard

    def close(self) -> None:
        """Ends the thread."""
        self._stop.set()
        # A request may take longer; the thread ends with the process.
        self._thread.join(TIMEOUT_S)

    def _request(self) -> None:
        planner: Optional[HandoverPlanner] = None
        reported = text = ""
        while True:
            try:
                planner = planner or HandoverPlanner(self._station)
                target = self._target
                target_m = target.at_m if target else None
                plan = planner.plan(
                    mass_kg=self._mass_kg,
                    width_m=self._width_m,
                    current_m=target_m,
                    frame=CurrentFrame.STATION if target else None,
                    current_slope_rad=target.slope_rad if target else None,
                )
                self._responses.put((target_m, plan))
                text = why_unusable(plan)
            except BusError as error:
                text = f"{error}"
            except Exception as error:  # The thread must not end.
                text = f"{type(error).__name__}: {error}"
            if text not in ("", reported):
                print(f"no plan: {text}", file=sys.stderr)
            reported = text
            if self._stop.wait(self._interval_s):
                break
        if planner:
            planner.close()


def why_unusable(plan: HandoverPlan | NoPlan) -> str:
    """Why there is no usable plan; empty for a usable one."""
    if isinstance(plan, NoPlan):
        return plan.text
    return "" if math.isfinite(plan.feet_heading_rad) else "the heading of the worker's feet is not finite"


def has_turned_away(plan: HandoverPlan, target: Optional[Plan]) -> bool:
    """Whether the present feet point elsewhere than the handles of the target."""
    turn_rad = math.remainder(plan.feet_heading_rad - target.heading_rad, math.tau) if target else 0.0
    return abs(turn_rad) > TURNED_AWAY_RAD


def is_out_of_reach(plan: HandoverPlan) -> bool:
    """Whether the requested place has no prediction for the present feet."""
    return plan.current_status not in (CurrentStatus.NONE, CurrentStatus.PREDICTED)


def is_outdated(plan: HandoverPlan) -> bool:
    """Whether the requested place is, for the present feet, worse than the planned one by more than 1 σ."""
    ratio, sigma = plan.current_limit_ratio, plan.current_limit_ratio_sigma
    if ratio is None or sigma is None:
        return False
    return ratio - plan.limit_ratio > math.hypot(sigma, plan.limit_ratio_sigma)


def input_of(
    reading: Reading | NoReading, part_m: Optional[Position], plan: Optional[Plan], is_held: bool = False
) -> Input:
    """What the decision needs of a reading."""
    if isinstance(reading, NoReading):
        return Input(part_m=part_m, plan=plan, is_held=is_held)
    state = reading.state
    limit_ratio = sigma = advice = None
    if not reading.invalidated_by(equipoise.INVALIDATES_TORQUES):
        at = state.worst_joint
        x, y, z = state.torque_nm[3 * at : 3 * at + 3]
        limit_nm = state.torque_limit_nm[at]
        limit_ratio, sigma = (x * x + y * y + z * z) ** 0.5 / limit_nm, state.torque_sigma_nm[at] / limit_nm
        if any(state.advice_direction) and state.joint_level[at] != Level.UNDECIDED:
            advice = (state.advice_direction[0], state.advice_direction[1], state.advice_direction[2])
    return Input(True, state.valid, reading.age_ns / 1e9, reading.restarted, limit_ratio, sigma, advice, part_m, plan, is_held)


def percentiles(name: str, values_s: List[float]) -> str:
    """Percentiles in microseconds."""
    ordered = sorted(values_s)
    if not ordered:
        return f"{name}_us=none"
    at = [ordered[int(quantile * (len(ordered) - 1))] for quantile in (0.5, 0.99, 0.999, 1.0)]
    return f"{name}_us=" + "/".join(f"{1e6 * value:.0f}" for value in at)


def address_of(text: str) -> Tuple[str, int]:
    """IPv4 address and port of `ADDRESS:PORT`. A name is resolved once: in the control loop it may take seconds."""
    host, colon, port = text.rpartition(":")
    if not colon or not host or not port.isdecimal() or not 0 < int(port) < 1 << 16:
        raise ValueError(f"{text}: give ADDRESS:PORT, for example 192.0.2.20:30004")
    try:
        found = socket.getaddrinfo(host, int(port), socket.AF_INET, socket.SOCK_STREAM)
    except OSError as error:
        raise ValueError(f"{text}: cannot resolve the address: {error.strerror}") from error
    return str(found[0][4][0]), int(port)


class Turns(Protocol):
    """Decides which of several cobots in a common space may move."""

    def may_move(self, station: str, now_s: float, wants: bool, limit_ratio: Optional[float]) -> bool:
        """Whether this station's cobot may move now. `wants`: it is not at its target; `limit_ratio`: of the worst joint."""


def control(
    station: str, name: str, cobot_address: Tuple[str, int], plans: Plans | DaemonPlans, stop: threading.Event,
    turns: Optional[Turns] = None,
) -> str:
    """Controls one cobot until `stop`; returns percentiles of the times from stage to stage.

    Without its turn a cobot counts as not ready: it holds and does not retreat.
    """
    prefix = f"station={station} " if turns else ""
    cobot, decision = Cobot(cobot_address), Decision()
    last, send_at_s, print_at_s = Command.HOLD, 0.0, 0.0
    bus_s: List[float] = []
    decision_s: List[float] = []
    with equipoise.subscribe(station, name=name, timeout_s=TIMEOUT_S) as consumer:
        for reading in consumer:
            # Before `poll`, which may wait: otherwise that time is missing from the gap to the next state.
            now_s = time.monotonic()
            cobot.poll()
            must_discard = False
            if isinstance(plans, Plans):
                plans.poll(now_s)
            elif isinstance(reading, Reading):
                must_discard = plans.ingest(reading, decision.target)
            given = input_of(reading, cobot.part_m(), plans.newest, cobot.is_held)
            if turns and not turns.may_move(station, now_s, cobot.is_able and decision.wants_to_move(given), given.limit_ratio):
                given = given._replace(part_m=None)
            # The decision holds and discards all plans so far, as after a restart.
            output = decision.decide(now_s, given._replace(restarted=given.restarted or must_discard))
            if output.command != last or now_s >= send_at_s:
                cobot.send(output)
                send_at_s = now_s + SEND_EVERY_S
                if isinstance(reading, Reading) and len(bus_s) < SAMPLES_MAX:
                    bus_s.append(max(reading.received_ns - reading.state.published_ns, 0) / 1e9)
                    decision_s.append(time.monotonic() - reading.received_ns / 1e9)
            if output.command != last or now_s >= print_at_s:
                why = "+".join(reading.reason_names) if isinstance(reading, Reading) else reading.reason.value
                x, y, z = output.target_m
                print(
                    f"{prefix}at_s={now_s:.3f} command={output.command.name.lower()} target_m={x:.3f},{y:.3f},{z:.3f} "
                    f"activity={cobot.activity} reasons={why}",
                    flush=True,
                )
                print_at_s = now_s + PRINT_EVERY_S
            last = output.command
            if isinstance(reading, NoReading) and reading.reason is NoStateReason.BUS:
                time.sleep(BUS_PAUSE_S)
            if stop.is_set():
                break
    if isinstance(plans, DaemonPlans):
        plans.close()
    # p50, p99, p99.9 and maximum of each stage.
    stages = (("bus", bus_s), ("decision", decision_s), ("cobot", cobot.answer_s))
    return f"end {prefix}" + " ".join(percentiles(name, values_s) for name, values_s in stages)


def main() -> None:
    parser = argparse.ArgumentParser(description="Handover controller: worker's state to cobot.")
    parser.add_argument("station")
    parser.add_argument("cobot", help="ADDRESS:PORT of RTDE")
    parser.add_argument("--name", default="handover")
    source = parser.add_mutually_exclusive_group()
    source.add_argument("--target", metavar="X,Y,Z", help="in the station's world, m")
    source.add_argument("--plan", help="file of `equipoise plan handover --out FILE`, read again when it changes")
    source.add_argument("--mass", type=float, metavar="KG", help="mass of the part: the daemon plans")
    parser.add_argument("--width", type=float, metavar="M", default=0.35, help="distance between the grips, with --mass")
    parser.add_argument("--interval", type=float, metavar="S", default=1.0, help="between two requests, with --mass")
    arguments = parser.parse_args()
    try:
        cobot = address_of(arguments.cobot)
    except ValueError as error:
        parser.error(f"{error}")
    try:
        plans: Plans | DaemonPlans = Plans(arguments.target, arguments.plan)
    except ValueError:
        parser.error("--target: give three numbers X,Y,Z in metres, for example 0.5,0.1,1.1")
    if arguments.mass is not None:
        try:
            plans = DaemonPlans(arguments.station, arguments.mass, arguments.width, arguments.interval)
        except ValueError as error:
            parser.error(f"{error}")
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda caught, frame: stop.set())
    print(control(arguments.station, arguments.name, cobot, plans, stop))


if __name__ == "__main__":
    main()
