"""Reads a recording with the mcap package and judges what it finds: python-mcap.py FILE SECONDS."""

import collections
import math
import sys

from mcap.reader import make_reader
from mcap_ros1.decoder import DecoderFactory

SEGMENTS, JOINTS = 23, 22
# Topic, and how many messages a second there must be at the least.
TOPICS = {"/equipoise/suit": 30, "/equipoise/ground": 100, "/equipoise/state": 500, "/equipoise/cycle": 500}


def check_suit(sample):
    assert len(sample.position_m) == 3 * SEGMENTS and len(sample.orientation_wxyz) == 4 * SEGMENTS
    for i in range(SEGMENTS):
        norm = math.hypot(*sample.orientation_wxyz[4 * i:4 * i + 4])
        assert abs(norm - 1.0) < 1e-3, f"segment {i}: a quaternion of length {norm}"


def check_state(state):
    assert len(state.torque_nm) == 3 * JOINTS and len(state.joint_level) == JOINTS
    values = [*state.torque_nm, *state.cop_measured_m, *state.com_m, state.mass_kg]
    assert all(math.isfinite(value) for value in values), "a number that is none"


CHECKS = {"/equipoise/suit": check_suit, "/equipoise/state": check_state}


def main():
    path, seconds = sys.argv[1], float(sys.argv[2])
    count, last = collections.Counter(), {}
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            topic = channel.topic
            count[topic] += 1
            CHECKS.get(topic, lambda _: None)(decoded)
            if topic in last:
                assert message.log_time >= last[topic][0], f"{topic}: time runs backwards"
            if topic == "/equipoise/state" and topic in last:
                assert decoded.cycle > last[topic][1].cycle, "a cycle twice"
            last[topic] = (message.log_time, decoded)
        for channel in reader.get_summary().channels.values():
            if channel.topic.startswith("/equipoise/"):
                assert channel.metadata["equipoise.type_name"].startswith("equipoise/"), channel.topic
                assert len(channel.metadata["equipoise.schema_hash"]) == 16, channel.topic
    for topic, rate in TOPICS.items():
        # Half the rate is enough: this looks at the format, and the machine may be busy.
        assert count[topic] >= 0.5 * rate * seconds, f"{topic}: only {count[topic]} messages in {seconds} s"
    assert last["/equipoise/ground"][1].force_n[2] > 200.0, "nobody stands on the plate"
    print("python-mcap: " + ", ".join(f"{topic} {count[topic]}" for topic in sorted(count)))


if __name__ == "__main__":
    try:
        main()
    except AssertionError as error:
        sys.exit(f"python-mcap: {error}")
