"""Plans of a handover: a position of the command line, or a file of `equipoise plan handover --out`.

clients/cpp/handover_plans.hpp has the same rules; clients/handover_vectors.txt tests both.
"""

from __future__ import annotations

import json
import math
import os
import sys
from typing import Any, List, Optional

from handover import Plan, Position

PLAN_EVERY_S = 0.2
SLOPE_MAX_RAD = 1.2
"""Range of the slope in clients/ur/handover.script, rad."""
HEADING_MAX_RAD = math.pi
"""Range of a heading, rad; the script limits it further."""


def parsed(text: str) -> Any:
    """The value of a JSON text."""

    def constant(word: str) -> Any:
        raise ValueError(f"{word} is not JSON")

    return json.loads(text, parse_constant=constant)


def finite(values: Any, count: int) -> List[float]:
    """These values as `count` finite numbers."""
    is_numeric = isinstance(values, list) and all(type(value) in (int, float) for value in values)
    numbers = [float(value) for value in values] if is_numeric else []
    if len(numbers) != count or not all(math.isfinite(number) for number in numbers):
        raise ValueError(f"not {count} finite numbers")
    return numbers


def target_of(words: str) -> Optional[Position]:
    """Position of `X,Y,Z`, m."""
    try:
        x, y, z = finite(parsed(f"[{words}]"), 3)
    except (ValueError, OverflowError, RecursionError):
        return None
    return x, y, z


def plan_of(text: str, generation: int) -> Optional[Plan]:
    """Plan of a file's text."""
    try:
        plan = parsed(text)
        x, y, z = finite(plan["position_m"], 3)
        # Without a slope: a plan of an earlier version.
        numbers = [plan["worst_limit_ratio"], plan["worst_limit_ratio_sigma"], plan.get("slope_rad", 0.0)]
        ratio, sigma, slope_rad = finite(numbers, 3)
        # Level handles do without a heading, too.
        (heading_rad,) = finite([plan.get("feet_heading_rad", None if slope_rad else 0.0)], 1)
    except (ValueError, OverflowError, RecursionError, KeyError, TypeError, AttributeError):
        return None
    if abs(slope_rad) > SLOPE_MAX_RAD or abs(heading_rad) > HEADING_MAX_RAD:
        return None
    return Plan(generation, (x, y, z), ratio, sigma, slope_rad, heading_rad)


class Plans:
    """The newest plan: a position of the command line, or a file, read again when it changes."""

    def __init__(self, target: Optional[str], path: Optional[str]) -> None:
        self._path = path
        self._changed_ns = 0
        self._due_s = 0.0
        self._text = self._reported = ""
        self.newest: Optional[Plan] = None
        if target is not None:
            at_m = target_of(target)
            if at_m is None:
                raise ValueError("not X,Y,Z")
            self.newest = Plan(1, at_m, 0.0, 0.0)

    def poll(self, now_s: float) -> None:
        """Reads the file if it has changed.

        A file that cannot be read leaves the plan as it is, as does one whose text is that of the last plan.
        """
        if self._path is None or now_s < self._due_s:
            return
        self._due_s = now_s + PLAN_EVERY_S
        try:
            changed_ns = os.stat(self._path).st_mtime_ns
            if changed_ns == self._changed_ns:
                return
            with open(self._path, encoding="utf-8", errors="surrogateescape", newline="") as file:
                text = file.read()
        except OSError as error:
            self._report(f"cannot be read: {error.strerror}")
            return
        plan = plan_of(text, self.newest.generation + 1 if self.newest else 1)
        if plan is None:
            # Read again at the next poll: it may be incomplete.
            self._report("no valid position_m, worst_limit_ratio, worst_limit_ratio_sigma, slope_rad and feet_heading_rad")
            return
        self._changed_ns = changed_ns
        self._reported = ""
        if text != self._text:
            self._text, self.newest = text, plan

    def _report(self, why: str) -> None:
        """Reports an unusable file once."""
        if why != self._reported:
            print(f"{self._path}: {why}; `equipoise plan handover --out {self._path}` writes it", file=sys.stderr)
            self._reported = why
