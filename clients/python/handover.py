"""Decision of a handover controller: from a reading of the worker's state to a command of the cobot. No I/O, no clock.

clients/cpp/handover.hpp is the same decision in C++; clients/handover_vectors.txt tests both. Not a safety function.

    python clients/python/handover.py < readings.txt

runs it on readings of the format of clients/cpp/handover_replay.cpp.
"""

from __future__ import annotations

import enum
import math
import sys
from typing import Any, Dict, List, NamedTuple, Optional, Sequence, Tuple

AGE_MAX_S = 0.05
"""Greatest age of a state, s."""
GAP_MAX_S = 0.05
"""A longer time between two decisions interrupts the valid readings, s."""
RESUME_AFTER_S = 0.5
"""Motion begins after uninterrupted valid readings of this duration, s."""
STATE_GAP_MAX_S = 0.9
"""`model_changed` lasts 1 s: after a gap of this duration between two states the worker may have changed, s."""
RETREAT_AFTER_S = 2.0
"""The cobot retreats after this time without a valid reading, if it has been ready for as long, s."""
BETTER_FOR_S = 1.0
"""A better target must stay better for this time, s."""
TARGET_M_PER_S = 0.1
"""Speed of the commanded position, m/s."""
TURN_RAD_PER_S = 0.3
"""Speed at which clients/ur/handover.script turns the handles, rad/s."""
TIME_STEP_MAX_S = 0.02
"""Longest time step that the commanded position is computed for, s."""
LAG_MAX_M = 0.05
"""A commanded position farther from the part restarts from the part, m."""
ARRIVED_M = 0.03
"""Distance from the target at which the part has arrived, m; the plans of one worker vary by more."""
ADVICE_ABOVE = 0.6
"""Without a plan the part is moved while the worst joint's limit ratio is above this ..."""
ADVICE_STEP_M = 0.05
"""... along the relieving direction, by this distance, m."""

# Values of `equipoise.Reason`; this file is also used without the package.
BELOW_LOAD_THRESHOLD = 1 << 5
MODEL_CHANGED = 1 << 6
INVALIDATES_TORQUES = (1 << 18) - 1
# Flags that stop the cobot. A worker without a load is a valid state: the part is still to be handed over.
STOPS = INVALIDATES_TORQUES & ~BELOW_LOAD_THRESHOLD

Position = Tuple[float, float, float]
"""Position in the station's world, m."""


class Plan(NamedTuple):
    """Place of the hands for the present worker and part."""

    generation: int
    """Increments with each new plan, from 1."""
    at_m: Position
    limit_ratio: float
    """Predicted limit ratio of the worst joint."""
    sigma: float
    """1-σ of `limit_ratio`."""
    slope_rad: float = 0.0
    """Slope of the handles: how far hands that follow them point below the horizontal, rad."""
    heading_rad: float = 0.0
    """Heading of the handles: that of the worker's feet, from the station's X axis about Z, rad. The grips lie on the
    station's Y axis turned by it, and slope about that axis."""


class Input(NamedTuple):
    """What a decision depends on, apart from time and earlier inputs."""

    has_state: bool = False
    """There is a current state; the fields up to `advice` belong to it."""
    reasons: int = 0
    age_s: float = 0.0
    restarted: bool = False
    limit_ratio: Optional[float] = None
    """Torque of the worst joint over its limit; None while torques are invalid."""
    sigma: Optional[float] = None
    """1-σ of `limit_ratio`."""
    advice: Optional[Position] = None
    """Relieving direction, unit vector."""
    part_m: Optional[Position] = None
    """Position of the part; None while the cobot is not connected or not ready."""
    plan: Optional[Plan] = None
    is_held: bool = False
    """The cobot does not follow the commands: outside the workspace, or no heartbeat."""


class Command(enum.IntEnum):
    """Command of the cobot: the value of its register."""

    HOLD = 0
    MOVE = 1
    RETREAT = 2


class Output(NamedTuple):
    """Command, and with MOVE the commanded position, m, and slope and heading of the handles, rad."""

    command: Command
    target_m: Position
    slope_rad: float = 0.0
    heading_rad: float = 0.0


class Decision:
    """The decision and its memory."""

    def __init__(self) -> None:
        self._decided_s: Optional[float] = None
        self._valid_s = 0.0
        # Time of the last state; since when readings are valid, the cobot is ready, another target is better.
        self._state_s: Optional[float] = None
        self._valid_since_s: Optional[float] = None
        self._ready_since_s: Optional[float] = None
        self._better_since_s: Optional[float] = None
        self._generation = self._discarded = 0
        # The target's plan has generation 0 if it comes from the advice.
        self._target: Optional[Plan] = None
        self._sent_m: Position = (0.0, 0.0, 0.0)
        self._is_moving = self._has_moved = False
        # Slope and heading of the handles in the last MOVE, rad, and upper bound of the remaining time of their turn to the
        # target's, s.
        self._slope_rad = self._heading_rad = self._turns_for_s = 0.0

    def decide(self, now_s: float, given: Input) -> Output:
        """Decides for this instant; `now_s` never decreases."""
        step_s = now_s - (self._decided_s if self._decided_s is not None else 0.0)
        interrupted = self._decided_s is None or step_s > GAP_MAX_S
        self._decided_s = now_s
        if given.plan and given.plan.generation > self._generation:
            self._generation = given.plan.generation
        may_have_changed = False
        if given.has_state:
            state_s = now_s - given.age_s
            is_gap = self._state_s is not None and state_s - self._state_s >= STATE_GAP_MAX_S
            may_have_changed = given.restarted or bool(given.reasons & MODEL_CHANGED) or is_gap
            self._state_s = state_s
        if may_have_changed:
            # The plan and the target were for another worker, or for another model of this one.
            self._discarded = self._generation
            self._target = self._better_since_s = None
        valid = (
            given.has_state and not given.restarted and not given.reasons & STOPS and 0.0 <= given.age_s <= AGE_MAX_S
        )
        if valid:
            self._valid_s = now_s
        if not valid or given.part_m is None or interrupted:
            self._valid_since_s = self._better_since_s = None
        if valid and given.part_m is not None and self._valid_since_s is None:
            self._valid_since_s = now_s
        if given.part_m is None or interrupted:
            self._ready_since_s = None
        if given.part_m is not None and self._ready_since_s is None:
            self._ready_since_s = now_s
        if self._valid_since_s is not None and given.part_m and now_s - self._valid_since_s >= RESUME_AFTER_S:
            self._choose(now_s, given, given.part_m)
            if self._target is not None:
                self._advance(step_s, self._target.at_m, given.part_m, given.is_held)
                self._slope_rad, self._heading_rad = self._target.slope_rad, self._target.heading_rad
                return Output(Command.MOVE, self._sent_m, self._slope_rad, self._heading_rad)
        self._is_moving = False
        is_ready = self._ready_since_s is not None and now_s - self._ready_since_s >= RETREAT_AFTER_S
        retreats = self._has_moved and is_ready and now_s - self._valid_s >= RETREAT_AFTER_S
        return Output(Command.RETREAT if retreats else Command.HOLD, self._sent_m)

    def _choose(self, now_s: float, given: Input, part_m: Position) -> None:
        target, plan = self._target, self._usable(given.plan)
        if plan:
            if target is None:
                self._set(plan)
            elif target.generation == plan.generation:
                self._better_since_s = None
            else:
                self._set_if_better(now_s, is_better(plan, target), plan)
            return
        is_planned = target is not None and target.generation != 0
        if is_planned or given.limit_ratio is None or given.sigma is None or given.advice is None:
            self._better_since_s = None
            return
        along = given.advice
        at_m = (
            part_m[0] + ADVICE_STEP_M * along[0],
            part_m[1] + ADVICE_STEP_M * along[1],
            part_m[2] + ADVICE_STEP_M * along[2],
        )
        advised = Plan(0, at_m, given.limit_ratio, given.sigma, self._slope_rad, self._heading_rad)
        self._set_if_better(now_s, given.limit_ratio - ADVICE_ABOVE > given.sigma, advised)

    def _set_if_better(self, now_s: float, is_better: bool, candidate: Plan) -> None:
        if not is_better:
            self._better_since_s = None
        elif self._better_since_s is None:
            self._better_since_s = now_s
        elif now_s - self._better_since_s >= BETTER_FOR_S:
            self._set(candidate)

    def wants_to_move(self, given: Input) -> bool:
        """Whether the reading is valid and the part must move or turn: toward its present or next target, or by the advice.
        For controllers that take turns."""
        is_valid = given.has_state and not given.reasons & STOPS and 0.0 <= given.age_s <= AGE_MAX_S
        if not is_valid or given.part_m is None:
            return False
        target, plan = self._target, self._usable(given.plan)
        if plan:
            target = plan if target is None or is_better(plan, target) else target
        elif given.advice and given.limit_ratio is not None and given.sigma is not None:
            if given.limit_ratio - ADVICE_ABOVE > given.sigma and (target is None or target.generation == 0):
                return True
        if target is None:
            return False
        # To another target the handles also turn by what remains of the present turn.
        turn_rad = 0.0 if target is self._target else self._turn_rad(target)
        is_turned = self._turns_for_s <= 0.0 and turn_rad <= 0.0
        return not is_turned or math.dist(target.at_m, given.part_m) > ARRIVED_M

    @property
    def target(self) -> Optional[Plan]:
        """The plan that is the target."""
        return self._target

    def _set(self, target: Plan) -> None:
        self._target, self._better_since_s = target, None
        # `_turn_rad` counts from the handles of the last command, which the cobot may not have reached.
        self._turns_for_s = max(self._turns_for_s, 0.0) + self._turn_rad(target) / TURN_RAD_PER_S

    def _usable(self, plan: Optional[Plan]) -> Optional[Plan]:
        """The plan, unless it is discarded. Without a heading the handles cannot be turned to the worker."""
        return plan if plan and plan.generation > self._discarded and math.isfinite(plan.heading_rad) else None

    def _turn_rad(self, target: Plan) -> float:
        """Upper bound of the turn from the handles of the last MOVE to those of a target, rad."""
        turn_rad = math.remainder(target.heading_rad - self._heading_rad, math.tau)
        return abs(target.slope_rad - self._slope_rad) + abs(turn_rad)

    def _advance(self, step_s: float, target_m: Position, part_m: Position, is_held: bool) -> None:
        """Moves the commanded position toward the target."""
        if not self._is_moving or is_held or math.dist(part_m, self._sent_m) > LAG_MAX_M:
            self._sent_m = part_m
        self._is_moving = self._has_moved = True
        self._turns_for_s -= min(step_s, TIME_STEP_MAX_S)
        x, y, z = (target_m[axis] - self._sent_m[axis] for axis in range(3))
        way_m = math.sqrt(x * x + y * y + z * z)
        most_m = TARGET_M_PER_S * min(step_s, TIME_STEP_MAX_S)
        if way_m <= most_m:
            self._sent_m = target_m
        else:
            part = most_m / way_m
            self._sent_m = (self._sent_m[0] + part * x, self._sent_m[1] + part * y, self._sent_m[2] + part * z)


def is_better(plan: Plan, target: Plan) -> bool:
    """Whether a plan's predicted limit ratio is below the target's by more than 1 σ of the difference."""
    return target.limit_ratio - plan.limit_ratio > math.hypot(target.sigma, plan.sigma)


def input_of(values: List[float]) -> Input:
    """The input in a line of readings."""

    def number(value: float) -> Optional[float]:
        return None if math.isnan(value) else value

    def position(at: int) -> Optional[Position]:
        return None if math.isnan(values[at]) else (values[at], values[at + 1], values[at + 2])

    at_m = position(14)
    plan = Plan(int(values[13]), at_m, *values[17:21]) if at_m else None
    has_state, reasons, age_s, restarted = values[1:5]
    limit_ratio, sigma = number(values[5]), number(values[6])
    advice, part_m, is_held = position(7), position(10), values[21] != 0
    return Input(has_state != 0, int(reasons), age_s, restarted != 0, limit_ratio, sigma, advice, part_m, plan, is_held)


def answer_of(line: str, plans: Dict[str, Any]) -> Optional[str]:
    """The answer to a line that is not a reading."""
    import handover_plans  # It imports this file.

    what, _, rest = line.rstrip("\n").partition(" ")
    values: Optional[Sequence[float]] = None
    if what == "target":
        values = handover_plans.target_of(rest)
    elif what == "file":
        plan = handover_plans.plan_of(rest, 1)
        values = (*plan.at_m, plan.limit_ratio, plan.sigma, plan.slope_rad, plan.heading_rad) if plan else None
    elif what == "poll":
        file = plans.setdefault(rest, handover_plans.Plans(None, rest))
        file.poll(math.inf)
        return str(file.newest.generation if file.newest else 0)
    else:
        return None
    return " ".join(f"{value:.9f}" for value in values) if values else "invalid"


def main() -> None:
    decision, plans = Decision(), dict[str, Any]()
    for line in sys.stdin:
        if line.strip() == "reset":
            decision = Decision()
            continue
        answer = answer_of(line, plans)
        if answer is not None:
            print(answer, flush=True)
            continue
        values = [float(word) for word in line.split()]
        command, (x, y, z), *turned_rad = decision.decide(values[0], input_of(values))
        print(int(command), *(f"{value:.9f}" for value in (x, y, z, *turned_rad)), flush=True)


if __name__ == "__main__":
    main()
