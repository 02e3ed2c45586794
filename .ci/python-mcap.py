"""Reads the end of a recording with the mcap package and evaluates what it finds: python-mcap.py FILE."""

import collections
import json
import math
import sys

from mcap.reader import make_reader
from mcap_ros1.decoder import DecoderFactory

import scene

SEGMENTS, JOINTS = 23, 22
# So much of the end is read, s.
SECONDS = 5
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
# Pictures, and how many a second there must be at the least.
PICTURES = {scene.SCENE: 20, scene.STATE: 20}


def check_pictures(path, begin_ns):
    """Figure and state: by the schemas in the file, and by Foxglove's own messages."""
    count, known, drawn, times = collections.Counter(), {}, collections.Counter(), {}
    with open(path, "rb") as file:
        for schema, channel, message in make_reader(file).iter_messages(list(PICTURES), starting_at=begin_ns):
            topic = channel.topic
            assert (channel.message_encoding, schema.encoding) == ("json", "jsonschema"), topic
            if topic not in known:
                text = json.loads(schema.data)
                assert text["title"] == schema.name, schema.name
                known[topic] = scene.validator(text)
            decoded = json.loads(message.data)
            scene.must_fit(known[topic], decoded, topic)
            count[topic] += 1
            times.setdefault(topic, []).append(message.log_time)
            if topic == scene.SCENE:
                drawn.update(scene.check_scene(decoded))
            else:
                scene.check_state(decoded)
                assert abs(decoded["t"] * 1e9 - message.log_time) < 1e3, "a state of another time"
    for topic, rate in PICTURES.items():
        assert count[topic] >= 0.5 * rate * SECONDS, f"{topic}: only {count[topic]} in {SECONDS} s"
        assert times[topic] == sorted(times[topic]), f"{topic}: time runs backwards"
    assert times[scene.SCENE] == times[scene.STATE], "a picture without its state"
    for name in ("figure", "support polygon", "centre of pressure, measured"):
        assert drawn[name] > 0, f"never drawn: {name}"
    # A validator that refuses nothing proves nothing.
    assert list(known[scene.STATE].iter_errors({"t": "now"})) and list(known[scene.SCENE].iter_errors({"entities": 1}))
    return ", ".join(f"{topic} {count[topic]}" for topic in PICTURES)


def main():
    path = sys.argv[1]
    count, last = collections.Counter(), {}
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        begin_ns = reader.get_summary().statistics.message_end_time - int(1e9 * SECONDS)
        for _, channel, message, decoded in reader.iter_decoded_messages(list(TOPICS), starting_at=begin_ns):
            topic = channel.topic
            count[topic] += 1
            CHECKS.get(topic, lambda _: None)(decoded)
            if topic in last:
                assert message.log_time >= last[topic][0], f"{topic}: time runs backwards"
            if topic == "/equipoise/state" and topic in last:
                assert decoded.cycle > last[topic][1].cycle, "a cycle twice"
            last[topic] = (message.log_time, decoded)
        for channel in reader.get_summary().channels.values():
            if channel.topic.startswith("/equipoise/") and channel.topic not in PICTURES:
                assert channel.metadata["equipoise.type_name"].startswith("equipoise/"), channel.topic
                assert len(channel.metadata["equipoise.schema_hash"]) == 16, channel.topic
    for topic, rate in TOPICS.items():
        # Half the rate is enough: this looks at the format, and the machine may be busy.
        assert count[topic] >= 0.5 * rate * SECONDS, f"{topic}: only {count[topic]} messages in {SECONDS} s"
    assert last["/equipoise/ground"][1].force_n[2] > 200.0, "no person stands on the plate"
    print("python-mcap: " + ", ".join(f"{topic} {count[topic]}" for topic in sorted(count)))
    print("python-mcap: " + check_pictures(path, begin_ns))


if __name__ == "__main__":
    try:
        main()
    except AssertionError as error:
        sys.exit(f"python-mcap: {error}")
