"""A viewer of the live gateway, next to a stuck one: foxglove.py PORT PID-OF-GATEWAY PID-OF-STATION.

Uses foxglove.sdk.v1 by the `websockets` package: text frames announce channels, binary ones carry messages.
"""

import json
import os
import signal
import socket
import struct
import sys
import time

from websockets.exceptions import WebSocketException
from websockets.sync.client import connect

import scene

HEARTBEAT = "/equipoise/heartbeat"
TOPICS = {scene.SCENE, scene.STATE, HEARTBEAT}
SECONDS = 6
# Ages on a machine that may be busy: they must be published, and be recent.
AGE_MAX_NS = 1_000_000_000


class Viewer:
    """Subscribes to everything that is announced."""

    def __init__(self, port):
        deadline = time.monotonic() + 20
        while True:
            try:
                self.socket = connect(f"ws://127.0.0.1:{port}", subprotocols=["foxglove.sdk.v1"], max_size=1 << 24)
                break
            except (OSError, WebSocketException):
                assert time.monotonic() < deadline, "the gateway does not serve"
                time.sleep(0.1)
        assert self.socket.subprotocol == "foxglove.sdk.v1"
        self.topics, self.known = {}, {}
        while len(self.topics) < len(TOPICS):
            said = json.loads(self.socket.recv(timeout=10))
            for channel in said.get("channels", []):
                number = len(self.topics)
                self.topics[number] = channel["topic"]
                assert (channel["encoding"], channel["schemaEncoding"]) == ("json", "jsonschema")
                self.known[channel["topic"]] = scene.validator(json.loads(channel["schema"]))
                ask = {"op": "subscribe", "subscriptions": [{"id": number, "channelId": channel["id"]}]}
                self.socket.send(json.dumps(ask))
        assert set(self.topics.values()) == TOPICS, self.topics

    def message(self):
        while True:
            frame = self.socket.recv(timeout=10)
            if isinstance(frame, bytes):
                kind, subscription, stamp = struct.unpack_from("<BIQ", frame)
                assert kind == 1, f"a frame of kind {kind}"
                topic, message = self.topics[subscription], json.loads(frame[13:])
                scene.must_fit(self.known[topic], message, topic)
                return topic, stamp, message


def resident_kib(process):
    with open(f"/proc/{process}/status", encoding="ascii") as status:
        return next(int(line.split()[1]) for line in status if line.startswith("VmRSS:"))


def watch(viewer, seconds):
    """Scenes, states and heartbeats for a while: counts, and what was drawn."""
    count, drawn, cycle, sequence_before = dict.fromkeys(TOPICS, 0), set(), 0, 0
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        topic, stamp, message = viewer.message()
        count[topic] += 1
        assert abs(stamp - time.time_ns()) < 60_000_000_000, "a time of another clock"
        if topic == scene.SCENE:
            drawn |= scene.check_scene(message)
        elif topic == scene.STATE:
            scene.check_state(message)
            assert message["cycle"] > cycle, "a cycle twice, or backwards"
            cycle = message["cycle"]
        else:
            assert message["sequence"] > sequence_before, "heartbeats run backwards"
            sequence_before = message["sequence"]
            if message["fresh"]:
                assert message["age_ns"] < AGE_MAX_NS and "no_state_reason" not in message, message
    return count, drawn


def main():
    port, gateway, station = int(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    stuck = Viewer(port)
    # No code takes this viewer's messages: the library's thread stops reading once a few are queued. Another sends nothing.
    silent_one = socket.create_connection(("127.0.0.1", port))
    time.sleep(SECONDS / 2)
    before = resident_kib(gateway)
    viewer = Viewer(port)
    count, drawn = watch(viewer, SECONDS)
    for topic in TOPICS:
        # Half the rate is enough: the machine may be busy.
        assert count[topic] >= 0.5 * 60 * SECONDS, f"{topic}: only {count[topic]} in {SECONDS} s"
    assert {"figure", "support polygon", "centre of pressure, measured"} <= drawn, drawn
    grown = resident_kib(gateway) - before
    assert grown < 16_384, f"the gateway has grown by {grown} KiB with a stuck viewer"
    print("foxglove: " + ", ".join(f"{topic} {count[topic]}" for topic in sorted(count)), f"in {SECONDS} s; {grown} KiB more")

    # The station is killed: within seconds viewers receive that there is no state, and why.
    os.kill(station, signal.SIGKILL)
    deadline, silent, cleared = time.monotonic() + 20, False, False
    while not (silent and cleared):
        assert time.monotonic() < deadline, "no message reports that the station is silent"
        topic, _, message = viewer.message()
        if topic == HEARTBEAT and not message["fresh"]:
            assert message["no_state_reason"] == "silent" and "age_ns" not in message, message
            silent = True
        if silent and topic == scene.SCENE:
            cleared = scene.check_scene(message) == {"words"}
    del stuck
    silent_one.close()
    print("foxglove: after the station's death only the reason is shown")


if __name__ == "__main__":
    try:
        main()
    except AssertionError as error:
        sys.exit(f"foxglove: {error}")
