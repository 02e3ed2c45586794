"""A cobot's controller, reduced to what it must check before it trusts a value. Prints a line a second.

    pip install ./clients/python
    python clients/python/controller.py station-1 arm-left
"""

from __future__ import annotations

import signal
import sys
import time
from typing import List

import equipoise
from equipoise import Level, NoReading, Reading, Reason

# How long the robot may go on without a new state.
TIMEOUT_S = 0.025
PRINT_EVERY_NS = 1_000_000_000
# Of so many states the p50 is taken.
LATENCIES_MAX = 1 << 16


def speed_percent(reading: Reading) -> int:
    """The robot's speed for this state, percent."""
    if reading.reasons == Reason.BELOW_LOAD_THRESHOLD:
        return 100  # Nothing is carried: that is knowledge, not the lack of it.
    if reading.invalidated_by(equipoise.INVALIDATES_TORQUES):
        return 25  # Torques are withheld: careful.
    # An undecided joint counts as its worst: its number is the highest.
    worst = max(reading.state.joint_level)
    return {Level.GREEN: 100, Level.ORANGE: 60}.get(worst, 25)


class Tally:
    """What is counted over the whole run."""

    def __init__(self) -> None:
        self.states = self.missed = self.silences = self.restarts = 0
        self.latest_due_ns = 0
        self.latencies_ns: List[int] = []

    def enter(self, reading: Reading) -> None:
        """Takes in a reading, which must be later than all before."""
        state = reading.state
        if state.time_ns <= self.latest_due_ns:
            sys.exit(f"an old state as new: cycle {state.cycle}")
        self.latest_due_ns = state.time_ns
        self.states += 1
        self.missed += reading.missed
        self.restarts += reading.restarted
        if len(self.latencies_ns) < LATENCIES_MAX:
            self.latencies_ns.append(max(reading.received_ns - state.published_ns, 0))

    def __str__(self) -> str:
        self.latencies_ns.sort()
        # The rank that half of the states lie at or below.
        p50_ns = self.latencies_ns[(len(self.latencies_ns) - 1) // 2] if self.latencies_ns else 0
        return (
            f"states={self.states} missed={self.missed} silences={self.silences} restarts={self.restarts} "
            f"p50_ns={p50_ns}"
        )


def line(reading: Reading | NoReading, tally: Tally) -> str:
    """The line of a second."""
    at_ns = time.monotonic_ns()
    if isinstance(reading, NoReading):
        return f"at_ns={at_ns} state={reading.reason.value} speed_percent=0 {tally}"
    state = reading.state
    return (
        f"at_ns={at_ns} state=current cycle={state.cycle} due_ns={state.time_ns} "
        f"age_us={(at_ns - state.time_ns) // 1000} speed_percent={speed_percent(reading)} "
        f"withheld={'+'.join(reading.reason_names)} {tally}"
    )


def main() -> None:
    if len(sys.argv) not in (3, 4):
        sys.exit("usage: controller.py STATION NAME [SECONDS]")
    stop: List[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda caught, frame: stop.append(caught))
    end_ns = time.monotonic_ns() + int(1e9 * float(sys.argv[3])) if len(sys.argv) == 4 else None
    tally, print_ns = Tally(), time.monotonic_ns() + PRINT_EVERY_NS
    bus_error = ""
    with equipoise.subscribe(sys.argv[1], name=sys.argv[2], timeout_s=TIMEOUT_S) as consumer:
        if consumer.report_refusal:
            print(f"{consumer.report_refusal}; reading goes on", file=sys.stderr)
        for reading in consumer:
            before, bus_error = bus_error, ""
            if isinstance(reading, Reading):
                tally.enter(reading)
            else:
                tally.silences += 1
                if reading.reason is equipoise.NoStateReason.BUS:
                    bus_error = reading.text
            if bus_error not in ("", before):
                print(bus_error, file=sys.stderr)
            # Command the robot's speed here: speed_percent, or 0 without a reading.
            if time.monotonic_ns() >= print_ns:
                print(line(reading, tally), flush=True)
                print_ns += PRINT_EVERY_NS
            if stop or (end_ns and time.monotonic_ns() >= end_ns):
                break
    print(f"end {tally}")


if __name__ == "__main__":
    main()
