"""Reads stations over Zenoh with programs that are not ours, and evaluates what comes. Started by .ci/zenoh.

Third parties: eclipse-zenoh (sessions, router), rosbags (definitions, type hash, CDR), zenoh-ros2-sdk (keys, tokens' QoS
and attachments of rmw_zenoh), xxhash (GIDs). No time is asserted: counts, orders, equalities and ratios are.
"""

import argparse
import collections
import importlib.util
import json
import os
import pathlib
import signal
import subprocess
import sys
import time

import xxhash
import zenoh
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from zenoh_ros2_sdk.attachment import Attachment
from zenoh_ros2_sdk.keyexpr import topic_keyexpr
from zenoh_ros2_sdk.qos import QosDurability, QosProfile, QosReliability

TYPE = "equipoise_msgs/msg/State"
DDS_TYPE = "equipoise_msgs::msg::dds_::State_"
PATIENCE_S = 240.0


def fail(what):
    sys.exit(f"zenoh: {what}")


def await_that(what, holds, patience_s=PATIENCE_S):
    end = time.monotonic() + patience_s
    while time.monotonic() < end:
        found = holds()
        if found:
            return found
        time.sleep(0.1)
    fail(f"waited {patience_s:.0f} s in vain for {what}")


def session(mode, **endpoints):
    config = zenoh.Config()
    config.insert_json5("mode", json.dumps(mode))
    config.insert_json5("scouting/multicast/enabled", "false")
    for kind in ("connect", "listen"):
        if kind in endpoints:
            config.insert_json5(f"{kind}/endpoints", json.dumps([endpoints[kind]]))
    end = time.monotonic() + 30
    while True:
        try:
            return zenoh.open(config)
        except zenoh.ZError as error:  # No process listens yet.
            if time.monotonic() > end:
                fail(f"no session with {endpoints}: {error}")
            time.sleep(0.5)


def serve_router(listen):
    with session("router", listen=listen):
        signal.pause()


def read_and_hang(endpoint):
    """Subscribes to everything and is stopped from outside."""
    with session("client", connect=endpoint) as opened:
        got = []
        opened.declare_subscriber("**", got.append)
        while not got:
            time.sleep(0.05)
        print("reads", flush=True)
        signal.pause()


class Stream:
    """What came under one key."""

    def __init__(self):
        self.messages, self.first, self.last, self.disorder = [], None, None, 0

    def take(self, sequence, message):
        if self.last is not None and sequence <= self.last:
            self.disorder += 1
        self.first = sequence if self.first is None else self.first
        self.last = sequence
        self.messages.append(message)

    def lost(self):
        return 0 if self.first is None else self.last - self.first + 1 - len(self.messages)


class Reader:
    def __init__(self, opened, store):
        self.json = collections.defaultdict(Stream)
        self.ros = collections.defaultdict(Stream)
        self.store, self.gids, self.bytes = store, collections.defaultdict(set), collections.defaultdict(list)
        self.subscribers = [
            opened.declare_subscriber("equipoise/*/state", self.take_json),
            opened.declare_subscriber(f"0/equipoise/*/state/{DDS_TYPE}/*", self.take_ros),
        ]

    def take_json(self, sample):
        payload = sample.payload.to_bytes()
        message = json.loads(payload)
        self.bytes["json"].append(len(payload))
        self.json[message["station"]].take(message["sequence"], message)

    def take_ros(self, sample):
        payload = sample.payload.to_bytes()
        message = self.store.deserialize_cdr(payload, TYPE)
        attachment = Attachment.from_bytes(sample.attachment.to_bytes())
        if attachment.sequence_id != message.sequence:
            fail(f"{message.station}: attachment {attachment.sequence_id}, message {message.sequence}")
        self.bytes["ros"].append(len(payload))
        self.gids[message.station].add(attachment.gid)
        self.ros[message.station].take(message.sequence, message)


def typestore(folder):
    store = get_typestore(Stores.ROS2_JAZZY)
    types = {}
    for path in sorted(pathlib.Path(folder).glob("*.msg")):
        types |= get_types_from_msg(path.read_text(), f"equipoise_msgs/msg/{path.stem}")
    store.register(types)
    return store


def check_tokens(opened, reader, type_hash):
    """A publisher's token says what rmw_zenoh needs to list and match it."""

    def publishers():
        replies = [reply.ok for reply in opened.liveliness().get("@ros2_lv/0/**", timeout=5.0)]
        tokens = [str(reply.key_expr).split("/") for reply in replies if reply is not None]
        found = [token for token in tokens if token[5] == "MP"]
        return found if len(found) == 3 else None

    for token in await_that("three publishers' tokens", publishers):
        topic, of, hash_, qos = (part.replace("%", "/") for part in token[9:])
        if (of, hash_) != (DDS_TYPE, type_hash):
            fail(f"token of {of} {hash_}; rosbags says {type_hash}")
        profile = QosProfile.decode(qos)
        if (profile.reliability, profile.durability) != (QosReliability.BEST_EFFORT, QosDurability.VOLATILE):
            fail(f"QoS {profile}")
        station = topic.split("/")[2]
        gid = xxhash.xxh3_128("/".join(token).encode()).intdigest().to_bytes(16, "little")
        if reader.gids[station] != {gid}:
            fail(f"{station}: GIDs {reader.gids[station]}, by its token {gid}")
        key = topic_keyexpr(0, topic, of, hash_)
        print(f"zenoh: ROS 2 finds {topic} as {key[:60]}…, {profile.reliability.name}")


def same(a, b):
    return abs(a - b) <= 1e-9 * max(1.0, abs(b))


def check_pair(ros, message):
    """CDR and JSON of one tick contain the same values."""
    state = message["state"]
    where = f"{ros.station} cycle {state['cycle']}"
    if (ros.phase, list(ros.reasons)) != (state["phase"], state["valid"]):
        fail(f"{where}: {ros.phase} {ros.reasons} and {state['phase']} {state['valid']}")
    for field, key in [("overload", "joints"), ("low_back", "l5s1_moment_nm"), ("load", "lifted_mass_kg"),
                       ("external_force", "delta_f_n"), ("cop_measured", "cop_measured"),
                       ("cop_estimated", "cop_estimated"), ("mass_kg", "mass_kg")]:
        if (len(getattr(ros, field)) > 0) != (key in state):
            fail(f"{where}: {field} holds {len(getattr(ros, field))}, and {key} is {state.get(key)}")
    if "mass_kg" in state and not same(ros.mass_kg[0], state["mass_kg"]):
        fail(f"{where}: mass {ros.mass_kg[0]} and {state['mass_kg']} kg")
    if "joints" not in state:
        return False
    for joint in ros.overload[0].joints:
        for got, expected in zip(joint.torque_nm, state["joints"][joint.name]["torque_nm"], strict=True):
            if not same(got, expected):
                fail(f"{where}: {joint.name} {joint.torque_nm}, in JSON {state['joints'][joint.name]}")
    return len(ros.overload[0].joints) > 0


def check_values(reader):
    def pairs(station):
        by_cycle = {m.cycle[0]: m for m in list(reader.ros[station].messages) if m.current}
        current = [m for m in list(reader.json[station].messages) if m["current"]]
        return [(by_cycle[m["state"]["cycle"]], m) for m in current if m["state"]["cycle"] in by_cycle]

    for station in ("north", "south"):
        compared = await_that(f"20 states of {station}", lambda s=station: len(p := pairs(s)) >= 20 and p)
        for ros, message in compared:
            check_pair(ros, message)
    loaded = await_that("overload torques of the demonstration",
                        lambda: any([check_pair(ros, message) for ros, message in pairs("demo")]) and pairs("demo"))
    print(f"zenoh: {len(loaded)} states of the demonstration are the same in CDR (read by rosbags) and JSON, "
          f"{sum('joints' in message['state'] for _, message in loaded)} of them with torques")


def counted(reader, seconds):
    """Messages of each stream within a time."""
    before = {name: len(stream.messages) for name, stream in reader.json.items()}
    time.sleep(seconds)
    return {name: len(stream.messages) - before.get(name, 0) for name, stream in reader.json.items()}


def resident_kib(process):
    status = pathlib.Path(f"/proc/{process}/status").read_text()
    return int(status.split("VmRSS:")[1].split()[0])


def check_stuck(reader, direct, gateway):
    stuck = subprocess.Popen([sys.executable, __file__, "hang", direct], stdout=subprocess.PIPE, text=True)
    try:
        if stuck.stdout.readline().strip() != "reads":
            fail("the subscriber that is to hang reads nothing")
        before, kib = counted(reader, 8)["demo"], resident_kib(gateway)
        stuck.send_signal(signal.SIGSTOP)
        # Past Zenoh's lease of 10 s, at whose end the link is closed.
        while_stuck, growth = counted(reader, 8)["demo"], resident_kib(gateway) - kib
        counted(reader, 6)
    finally:
        stuck.kill()
        stuck.wait()
    print(f"zenoh: with a hanging subscriber another one got {while_stuck} messages, {before} without it; "
          f"the gateway grew by {growth} KiB")
    if before == 0:
        fail("nothing came before anybody hung")
    if while_stuck < 0.7 * before:
        fail("a subscriber that hangs slows another")
    if growth > 4096:
        fail("a subscriber that hangs makes the gateway grow")


def check_bad_link(reader, namespace):
    shape = ["tc", "-n", namespace, "qdisc"]
    rule = ["dev", "eqp0", "root", "netem", "delay", "40ms", "10ms", "loss", "5%"]
    if subprocess.run([*shape, "add", *rule], capture_output=True, check=False).returncode != 0:
        print("zenoh: no netem here: loss and delay were not tried")
        return
    lost = {name: stream.lost() for name, stream in reader.ros.items()}
    got = {name: len(stream.messages) for name, stream in reader.ros.items()}
    try:
        counted(reader, 10)
    finally:
        subprocess.run([*shape, "del", "dev", "eqp0", "root"], check=True)
    for name, stream in sorted(reader.ros.items()):
        print(f"zenoh: {name} over a link with 40±10 ms and 5 % loss: {len(stream.messages) - got[name]} came, "
              f"{stream.lost() - lost[name]} lost by the sequence numbers")
        if len(stream.messages) == got[name]:
            fail(f"{name}: nothing came over the bad link")


def check_ends(opened, reader, daemon, gateway):
    os.kill(daemon, signal.SIGKILL)
    await_that("the word that north's daemon is silent",
               lambda: reader.json["north"].messages[-1].get("no_state_reason") == "silent", 30)
    last = reader.ros["north"].messages[-1]
    if last.current or last.no_state_reason != "silent" or len(last.fatigue) or len(last.mass_kg):
        fail(f"a silent station's ROS message holds values: {last}")
    changes = []
    watch = opened.liveliness().declare_subscriber(
        "equipoise/*/alive", lambda sample: changes.append((str(sample.kind), str(sample.key_expr))), history=True)
    await_that("south's token", lambda: any("south" in key for _, key in changes), 30)
    os.kill(gateway, signal.SIGKILL)
    await_that("the end of south's token",
               lambda: any("DELETE" in kind and "south" in key for kind, key in changes), 30)
    watch.undeclare()
    print("zenoh: a daemon's end is reported as silence, a gateway's by its token")


def cpu_s(process):
    fields = pathlib.Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def received_bytes():
    return int(pathlib.Path("/sys/class/net/eqp0/statistics/rx_bytes").read_text())


def many(opened, store, arguments):
    """A hundred stations to one subscriber by wildcard."""
    count, rate_hz, seconds = 100, 10, 20
    reader = Reader(opened, store)
    simulated = subprocess.Popen(["ip", "netns", "exec", arguments.stations, arguments.simulated, arguments.router,
                                  str(count), str(rate_hz), str(seconds + 15)])
    try:
        names = [f"simulated-{number}" for number in range(1, count + 1)]
        await_that("a hundred stations", lambda: all(reader.json[name].messages for name in names), 60)
        of = (simulated.pid, arguments.router_process, os.getpid())
        start = [cpu_s(process) for process in of], received_bytes(), time.monotonic()
        before = {name: (len(reader.json[name].messages), len(reader.ros[name].messages)) for name in names}
        time.sleep(seconds)
        passed_s = time.monotonic() - start[2]
        cpu = [100 * (cpu_s(process) - at) / passed_s for process, at in zip(of, start[0], strict=True)]
        mbit = (received_bytes() - start[1]) * 8e-6 / passed_s
    finally:
        simulated.kill()
        simulated.wait()
    came = [sum(len(getattr(reader, kind)[n].messages) - before[n][at] for n in names)
            for at, kind in enumerate(("json", "ros"))]
    lost = [sum(getattr(reader, kind)[n].lost() for n in names) for kind in ("json", "ros")]
    disorder = sum(reader.json[n].disorder + reader.ros[n].disorder for n in names)
    size = {kind: sum(sizes) / len(sizes) for kind, sizes in reader.bytes.items()}
    print(f"zenoh: {count} stations at {rate_hz} Hz, {passed_s:.1f} s: JSON {came[0]} came, {lost[0]} lost, "
          f"{size['json']:.0f} bytes each; CDR {came[1]} came, {lost[1]} lost, {size['ros']:.0f} bytes each; "
          f"{mbit:.1f} Mbit/s on the link; CPU: 100 publishers {cpu[0]:.0f} %, router {cpu[1]:.0f} %, "
          f"this subscriber {cpu[2]:.0f} %")
    paper = count * rate_hz * (size["json"] + size["ros"]) * 8e-6
    print(f"zenoh: on paper {paper:.1f} Mbit/s of payload")
    if disorder:
        fail(f"{disorder} messages came out of order")
    if not all(came):
        fail("nothing came of a hundred stations")


def evaluate(arguments):
    store = typestore(arguments.definitions)
    opened = session("client", connect=arguments.router)
    reader = Reader(opened, store)
    await_that("states of three stations", lambda: len(reader.json) >= 3 and len(reader.ros) >= 3)
    check_tokens(opened, reader, store.hash_rihs01(TYPE))
    check_values(reader)
    check_stuck(reader, arguments.direct, arguments.demo_gateway)
    check_bad_link(reader, arguments.stations)
    dashboard = load_dashboard()
    stations = {}
    with dashboard.subscribe(arguments.router, stations):
        await_that("three stations on the dashboard", lambda: len(stations) == 3, 30)
        check_ends(opened, reader, arguments.north, arguments.south_gateway)
        time.sleep(1.5)
        lines = {name: station.line(name, time.monotonic(), 0.5) for name, station in stations.items()}
    for name, (text, colour) in sorted(lines.items()):
        print(f"zenoh: dashboard: {text}")
        if name in ("north", "south") and colour != dashboard.GREY:
            fail(f"the dashboard does not grey {name}")
    for kind in ("json", "ros"):
        for name, stream in sorted(getattr(reader, kind).items()):
            print(f"zenoh: {name} {kind}: {len(stream.messages)} came, {stream.lost()} lost")
            if stream.disorder or stream.lost() < 0:
                fail(f"{name} {kind}: out of order")
    for subscriber in reader.subscribers:
        subscriber.undeclare()
    many(opened, store, arguments)
    opened.close()


def load_dashboard():
    path = pathlib.Path(__file__).parent.parent / "clients/zenoh/dashboard.py"
    spec = importlib.util.spec_from_file_location("dashboard", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def main():
    parser = argparse.ArgumentParser()
    verbs = parser.add_subparsers(dest="verb", required=True)
    for verb in ("router", "hang"):
        verbs.add_parser(verb).add_argument("endpoint")
    evaluating = verbs.add_parser("evaluate")
    for name in ("router", "direct", "definitions", "stations", "simulated"):
        evaluating.add_argument(f"--{name}", required=True)
    for name in ("demo-gateway", "north", "south-gateway", "router-process"):
        evaluating.add_argument(f"--{name}", type=int, required=True)
    arguments = parser.parse_args()
    if arguments.verb == "router":
        serve_router(arguments.endpoint)
    elif arguments.verb == "hang":
        read_and_hang(arguments.endpoint)
    else:
        evaluate(arguments)


if __name__ == "__main__":
    main()
