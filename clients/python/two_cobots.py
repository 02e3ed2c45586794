"""Controller of several handovers whose cobots share a space: one cobot moves at a time. docs/cobot.md. Not a safety function.

    pip install ./clients/python
    python clients/python/two_cobots.py --mass 6 station-1=192.0.2.20:30004 station-2=192.0.2.21:30004

Which cobot moves next is the integrator's decision; here the one whose worker is closest to a limit (`Turns`).
"""

from __future__ import annotations

import argparse
import signal
import threading
from typing import Dict, List, Optional, Tuple

from handover_controller import DaemonPlans, address_of, control

# Longest turn, s: 1.2 m at the commanded 0.1 m/s. The turn of an arm that cannot reach its target ends.
TURN_MAX_S = 12.0
# A turn ends if its station has not requested it for this time. The cobot of a stopped controller is at rest by then: it
# holds 60 ms after the last command.
TURN_LOST_S = 0.5


class Turns:
    """One cobot moves at a time, until it has arrived or its worker's state is invalid. Next: the largest limit ratio."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        # By station that requests a turn: time of its last request, s, and the limit ratio of its worker's worst joint.
        self._wishes: Dict[str, Tuple[float, float]] = {}
        self._holder: Optional[str] = None
        self._holder_at_s = self._holder_since_s = 0.0
        # The station whose turn ended at TURN_MAX_S, until another station has had a turn.
        self._last: Optional[str] = None

    def may_move(self, station: str, now_s: float, wants: bool, limit_ratio: Optional[float]) -> bool:
        """Whether this station's cobot may move now; called with each reading. `limit_ratio`: of the worst joint."""
        with self._lock:
            if wants:
                # Without a load in the hands there is no limit ratio: such a worker is served after the others.
                self._wishes[station] = (now_s, limit_ratio or 0.0)
            else:
                self._wishes.pop(station, None)
            self._wishes = {at: wish for at, wish in self._wishes.items() if now_s - wish[0] < TURN_LOST_S}
            if self._holder == station and wants:
                self._holder_at_s = now_s
            if self._holder == station and not wants or now_s - self._holder_at_s > TURN_LOST_S:
                self._holder = None
            if self._holder is not None and now_s - self._holder_since_s > TURN_MAX_S:
                self._last, self._holder = self._holder, None
            if self._holder is None and self._wishes:
                self._holder = max(self._wishes, key=lambda at: (at != self._last, self._wishes[at][1]))
                self._holder_at_s = self._holder_since_s = now_s
                if self._holder != self._last:
                    self._last = None
            return self._holder == station


def cobot_of(pair: str) -> Tuple[str, Tuple[str, int]]:
    """Station, and address and port of its cobot, of `STATION=ADDRESS:PORT`."""
    station, _, address = pair.partition("=")
    if not station or ":" not in address:
        raise ValueError(f"{pair}: give STATION=ADDRESS:PORT, for example station-1=192.0.2.20:30004")
    return station, address_of(address)


def main() -> None:
    parser = argparse.ArgumentParser(description="Handover controller of several stations: one cobot moves at a time.")
    parser.add_argument("stations", nargs="+", metavar="STATION=ADDRESS:PORT", help="a station, and RTDE of its cobot")
    parser.add_argument("--mass", type=float, metavar="KG", required=True, help="mass of the parts")
    parser.add_argument("--width", type=float, metavar="M", default=0.35, help="distance between the grips")
    parser.add_argument("--interval", type=float, metavar="S", default=1.0, help="between two requests for a plan")
    arguments = parser.parse_args()
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda caught, frame: stop.set())
    turns = Turns()
    failures: List[str] = []
    threads: List[threading.Thread] = []

    def run(station: str, cobot: Tuple[str, int], plans: DaemonPlans) -> None:
        try:
            print(control(station, "handover", cobot, plans, stop, turns))
        except BaseException as error:
            failures.append(f"{station}: {error}")
            stop.set()

    try:
        cobots = [cobot_of(pair) for pair in arguments.stations]
    except ValueError as error:
        parser.error(f"{error}")
    for pair, (station, cobot) in zip(arguments.stations, cobots):
        if sum(station == other or cobot == address for other, address in cobots) > 1:
            parser.error(f"{pair}: its station or its cobot is given twice")
    for station, cobot in cobots:
        try:
            plans = DaemonPlans(station, arguments.mass, arguments.width, arguments.interval)
        except ValueError as error:
            parser.error(f"{error}")
        threads.append(threading.Thread(target=run, args=(station, cobot, plans)))
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if failures:
        raise SystemExit("; ".join(failures))


if __name__ == "__main__":
    main()
