#!/usr/bin/env python3
"""All stations on one screen, a line each: pip install eclipse-zenoh; dashboard.py tcp/ADDRESS:7447

What is not current is greyed and never shown as a value: a station that says it has no state, and one of which nothing
came for --stale-s seconds by this machine's clock. Levels are words as well as colours.
"""

import argparse
import json
import sys
import time

import zenoh

GREY, RESET = "\033[90m", "\033[0m"
# Those of view/src/levels.json.
COLOURS = {
    "green": "\033[38;2;23;32;43;48;2;0;158;115m",
    "orange": "\033[38;2;23;32;43;48;2;240;173;0m",
    "red": "\033[38;2;255;255;255;48;2;201;60;0m",
    "above_max": "\033[38;2;255;255;255;48;2;106;27;110m",
}
# Undecided might be any of those before it.
WORST = ["none", "green", "orange", "red", "undecided", "above_max"]


class Station:
    """Last message of a station, with counts."""

    def __init__(self):
        self.message, self.received_s, self.lost, self.got = None, 0.0, 0, 0

    def take(self, message, now_s):
        before, self.message, self.received_s = self.message, message, now_s
        self.got += 1
        if before and before["session"] == message["session"]:
            self.lost += max(0, message["sequence"] - before["sequence"] - 1)

    def line(self, name, now_s, stale_s):
        """Text and colour."""
        silent_s = now_s - self.received_s
        count = f"{self.got} came, {self.lost} lost"
        if silent_s > stale_s:
            return f"{name:16} nothing for {silent_s:.1f} s; {count}", GREY
        if not self.message["current"]:
            return f"{name:16} no state: {self.message['no_state_reason']}; {count}", GREY
        state = self.message["state"]
        age_ms = self.message["age_ns"] / 1e6 + silent_s * 1e3
        start = f"{name:16} {state['phase']:12} age {age_ms:6.1f} ms"
        if "joints" not in state:
            return f"{start} withheld: {', '.join(state['valid']) or 'no reason reported'}; {count}", GREY
        level = max((joint["level"] for joint in state["joints"].values()), key=WORST.index, default="none")
        worst = state.get("worst_joint", "-")
        return f"{start} {level:10} worst {worst:16} lifts {state['lifts']}; {count}", COLOURS.get(level, "")


def subscribe(endpoint, stations):
    """A session whose subscriber fills `stations`, a dictionary by name."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    session = zenoh.open(config)

    def take(sample):
        message = json.loads(sample.payload.to_bytes())
        stations.setdefault(message["station"], Station()).take(message, time.monotonic())

    session.declare_subscriber("equipoise/*/state", take)
    return session


def main():
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("endpoint", help="a router or a station, as Zenoh writes it: tcp/192.0.2.30:7447")
    arguments.add_argument("--stale-s", type=float, default=0.5)
    arguments.add_argument("--every-s", type=float, default=1.0)
    arguments.add_argument("--times", type=int, default=0, help="how often; 0: until it is stopped")
    chosen = arguments.parse_args()
    stations, shown = {}, 0
    with subscribe(chosen.endpoint, stations):
        while chosen.times == 0 or shown < chosen.times:
            time.sleep(chosen.every_s)
            shown += 1
            for name in sorted(stations.copy()):
                text, colour = stations[name].line(name, time.monotonic(), chosen.stale_s)
                print(f"{colour}{text}{RESET}" if sys.stdout.isatty() else text, flush=True)


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        pass
