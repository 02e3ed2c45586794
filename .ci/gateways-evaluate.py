"""All gateways on one daemon: gateways-evaluate.py evaluate EQUIPOISE FOLDER SCRATCH SECONDS KIND=PORT...

Each client is a separate process (gateways-evaluate.py client KIND PORT), with a third-party library where one exists. It
prints "reads" after its first message; a client that is to hang is stopped then. Phases alternate, so that other load on
the machine affects all of them: alone, with clients that read, with clients that hang. No time is asserted: fractions of
cycles in the same run are compared, and page faults of the loop are counted.
"""

import asyncio
import json
import os
import pathlib
import signal
import socket
import struct
import subprocess
import sys
import threading
import time

STATION = "demo"
ROUNDS, PHASES = 3, ("alone", "reading", "hanging")
PATIENCE_S = 60
OF_OUR_OWN = ("udp", "rtde")


def reads():
    print("reads", flush=True)


# Clients.

def read_udp(port):
    with socket.socket(type=socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", port))
        receiver.recv(65536)
        reads()
        while True:
            receiver.recv(65536)


def read_rtde(port):
    """A controller, as far as the gateway asks for one: it accepts everything, sends its timestamp, and takes what comes."""
    with socket.create_server(("127.0.0.1", port)) as server:
        has_data = False
        while True:
            connection, _ = server.accept()
            try:
                with connection, connection.makefile("rb") as stream:
                    while head := stream.read(3):
                        payload = stream.read(int.from_bytes(head[:2], "big") - 3)
                        has_data = answer_rtde(connection, head[2:], payload, has_data)
            except OSError:
                pass  # The gateway has left; it comes again.


def answer_rtde(connection, kind, payload, has_data):
    """Answers one package; whether data have come."""
    def package(kind, payload):
        return (3 + len(payload)).to_bytes(2, "big") + kind + payload

    def send_timestamps():
        try:
            while True:
                connection.sendall(package(b"U", b"\x01" + struct.pack(">d", time.monotonic())))
                time.sleep(0.02)
        except OSError:
            pass  # The gateway has left.

    if kind == b"U":
        if not has_data:
            reads()
        return True
    kinds = ["INT32" if b"_int_" in name else "DOUBLE" for name in payload.split(b",")]
    answers = {b"V": b"\x01", b"v": struct.pack(">4I", 5, 22, 0, 0), b"O": b"\x01DOUBLE", b"S": b"\x01",
               b"I": b"\x01" + ",".join(kinds).encode()}
    connection.sendall(package(kind, answers[kind]))
    if kind == b"S":
        threading.Thread(target=send_timestamps, daemon=True).start()
    return has_data


def read_page(port):
    connection = connect(port)
    connection.sendall(b"GET /events HTTP/1.1\r\nHost: 127.0.0.1\r\nAccept: text/event-stream\r\n\r\n")
    got = b""
    while b"data:" not in got:
        got += connection.recv(65536)
    reads()
    while connection.recv(65536):
        pass


def read_zenoh(port):
    import zenoh

    config = zenoh.Config()
    for key, value in [("mode", '"client"'), ("scouting/multicast/enabled", "false"),
                       ("connect/endpoints", json.dumps([f"tcp/127.0.0.1:{port}"]))]:
        config.insert_json5(key, value)
    connect(port).close()
    with zenoh.open(config) as session:
        subscriber = session.declare_subscriber("**")
        for number, _ in enumerate(subscriber):
            if number == 0:
                reads()


def read_opcua(port):
    import asyncua

    class Handler:
        """What a subscription calls."""

        has_data = False

        def datachange_notification(self, *_):
            if not self.has_data:
                self.has_data = True
                reads()

    async def variables(node):
        found = []
        for child in await node.get_children():
            if await child.read_node_class() == asyncua.ua.NodeClass.Variable:
                found.append(child)
            else:
                found += await variables(child)
        return found

    async def read():
        connect(port).close()
        async with asyncua.Client(f"opc.tcp://127.0.0.1:{port}/", timeout=20) as client:
            stations = [node for node in await client.nodes.objects.get_children()
                        if (await node.read_browse_name()).Name == STATION]
            found = await variables(stations[0])
            subscription = await client.create_subscription(50, Handler())
            await subscription.subscribe_data_change(found[:50])
            await asyncio.sleep(3600)

    asyncio.run(read())


def read_foxglove(port):
    from websockets.sync.client import connect as open_websocket

    connect(port).close()
    with open_websocket(f"ws://127.0.0.1:{port}", subprotocols=["foxglove.sdk.v1"]) as websocket:
        number, has_data = 0, False
        while True:
            message = websocket.recv()
            if isinstance(message, bytes):
                if not has_data:
                    has_data = True
                    reads()
                continue
            said = json.loads(message)
            if said["op"] == "advertise":
                asked = []
                for channel in said["channels"]:
                    number += 1
                    asked.append({"id": number, "channelId": channel["id"]})
                websocket.send(json.dumps({"op": "subscribe", "subscriptions": asked}))


def connect(port):
    """Until somebody listens."""
    end = time.monotonic() + PATIENCE_S
    while True:
        try:
            return socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)
        except OSError:
            if time.monotonic() > end:
                raise
            time.sleep(0.1)


# Evaluation.

def fail(what):
    sys.exit(f"gateways: {what}")


class House:
    """The daemon and the other processes of a phase."""

    def __init__(self, equipoise, folder, scratch, ports):
        self.equipoise, self.scratch, self.ports, self.running = equipoise, scratch, ports, []
        self.config = scratch / "station.toml"
        self.kinds = {"page": [equipoise, "view", "--config", self.config]}
        for kind in ("udp", "rtde", "opcua", "mqtt", "zenoh", "foxglove"):
            program = folder / f"equipoise-gateway-{kind}"
            if kind in OF_OUR_OWN:
                self.kinds[kind] = [equipoise, "gateway", kind, "--config", self.config]
            else:
                if not program.exists():
                    fail(f"{program} is not there: build it, or name the folder with GATEWAYS")
                self.kinds[kind] = [program, "--config", self.config]

    def asked(self, *words):
        done = subprocess.run([self.equipoise, *words, "--station", STATION, "--json"], capture_output=True, text=True,
                              check=False)
        return json.loads(done.stdout) if done.stdout else None

    def client(self, kind):
        """Its command, and what it says when something has come."""
        if kind == "mqtt":
            return [os.environ["MOSQUITTO"], "-c", self.scratch / "mosquitto.conf", "-v"], "PUBLISH"
        return [sys.executable, __file__, "client", kind, str(self.ports[kind])], "reads"

    def start(self, hang):
        """Gateways and clients; returns when each client has read something, and hangs if it is to."""
        libraries = os.environ.get("MOSQUITTO_LIBRARIES")
        with_libraries = {**os.environ, **({"LD_LIBRARY_PATH": libraries} if libraries else {})}
        clients = {}
        for kind in self.kinds:
            command, word = self.client(kind)
            path = self.scratch / f"client-{kind}.log"
            path.write_text("")
            with path.open("a") as log:
                process = subprocess.Popen(command, stdout=log, stderr=log,
                                           env=with_libraries if kind == "mqtt" else None)
            self.running.append(process)
            clients[kind] = (process, word, path)
        for kind, command in self.kinds.items():
            with (self.scratch / f"gateway-{kind}.log").open("a") as log:
                self.running.append(subprocess.Popen(command, stdout=log, stderr=log))
        for kind, (process, word, path) in clients.items():
            end = time.monotonic() + PATIENCE_S
            while word not in path.read_text():
                if time.monotonic() > end or process.poll() is not None:
                    fail(f"the client of {kind} read nothing in {PATIENCE_S} s: {path.read_text()[-500:]}")
                time.sleep(0.1)
            if hang:
                process.send_signal(signal.SIGSTOP)

    def stop(self):
        for process in self.running:
            process.send_signal(signal.SIGCONT)
            process.terminate()
        for process in self.running:
            try:
                process.wait(timeout=10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        self.running = []


def ms(ns):
    return f"{ns * 1e-6:.2f}"


def print_consumers(report):
    """Of the newest suit sample's own time, and of the schedule, to the consumer's hand."""
    print("| consumer | states | from due p50 | p90 | p99 | from suit p50 | p90 | p99 | max |")
    print("|---|---|---|---|---|---|---|---|---|")
    for consumer in sorted(report["consumers"], key=lambda consumer: consumer["consumer"]):
        stages = {stage["stage"].rsplit(".", 1)[1]: stage for stage in consumer["stages"]}
        due, suit = stages["from_due"], stages["from_suit"]
        cells = [due["p50_ns"], due["p90_ns"], due["p99_ns"], suit["p50_ns"], suit["p90_ns"], suit["p99_ns"],
                 suit["max_ns"]]
        print(f"| `{consumer['consumer']}` | {consumer['states']} | {' | '.join(map(ms, cells))} |")


def evaluate(equipoise, folder, scratch, seconds, ports):
    house = House(equipoise, folder, scratch, ports)
    end = time.monotonic() + PATIENCE_S
    # The loop's page faults are counted from the end of its warm-up on.
    while (house.asked("status") or {}).get("daemon", {}).get("loop_faults") is None:
        if time.monotonic() > end:
            fail("the daemon does not run")
        time.sleep(0.5)
    sums = {phase: {"cycles": 0, "slots_skipped": 0, "deadlines_missed": 0, "wakes": [], "late": []}
            for phase in PHASES}
    time.sleep(3)  # The daemon's own start is not what is looked at.
    faults, shown = house.asked("status")["daemon"]["loop_faults"], None
    try:
        for _ in range(ROUNDS):
            for phase in PHASES:
                if phase != "alone":
                    house.start(hang=phase == "hanging")
                time.sleep(1)
                report = house.asked("latency", "--for", str(seconds))
                for key in ("cycles", "slots_skipped", "deadlines_missed"):
                    sums[phase][key] += report[key]
                late = report["slots_skipped"] + report["deadlines_missed"]
                sums[phase]["late"].append(late / (report["cycles"] + report["slots_skipped"]))
                sums[phase]["wakes"] += [stage for stage in report["stages"] if stage["stage"] == "loop.wake"]
                if phase == "reading":
                    shown = report
                dead = [process.args for process in house.running if process.poll() is not None]
                if dead:
                    fail(f"ended by itself in phase {phase}: {dead}")
                house.stop()
    finally:
        house.stop()
    print(f"gateways: {', '.join(sorted(house.kinds))}; {ROUNDS} rounds of {seconds} s in each phase")
    print("| phase | cycles | slots skipped | deadlines missed | loop.wake p50 (ms) | p99 | max |")
    print("|---|---|---|---|---|---|---|")
    late_fraction = {}
    for phase, all_ in sums.items():
        wakes = all_["wakes"]
        worst = [sorted(wake[key] for wake in wakes)[len(wakes) // 2] for key in ("p50_ns", "p99_ns")]
        print(f"| {phase} | {all_['cycles']} | {all_['slots_skipped']} | {all_['deadlines_missed']} | "
              f"{ms(worst[0])} | {ms(worst[1])} | {ms(max(wake['max_ns'] for wake in wakes))} |")
        # The median of the rounds: on a shared machine neighbours disturb one of them.
        late_fraction[phase] = sorted(all_["late"])[len(all_["late"]) // 2]
    print_consumers(shown)
    for phase in ("reading", "hanging"):
        if late_fraction[phase] > 2 * late_fraction["alone"] + 0.002:
            fail(f"{100 * late_fraction[phase]:.2f} % of the slots were late with gateways ({phase}), "
                 f"{100 * late_fraction['alone']:.2f} % without")
    after = house.asked("status")["daemon"]["loop_faults"]
    if after != faults:
        fail(f"page faults of the loop: {faults} before, {after} after")
    missing = {"view" if kind == "page" else kind for kind in house.kinds} - {c["consumer"] for c in shown["consumers"]}
    if missing:
        fail(f"no receipt of these consumers: {missing}")


def main():
    verb, *rest = sys.argv[1:]
    if verb == "client":
        kind, port = rest
        globals()[f"read_{kind}"](int(port))
    else:
        equipoise, folder, scratch, seconds, *ports = rest
        ports = {kind: int(port) for kind, port in (pair.split("=") for pair in ports)}
        evaluate(equipoise, pathlib.Path(folder), pathlib.Path(scratch), float(seconds), ports)


if __name__ == "__main__":
    main()
