"""Watches what the MQTT gateway publishes to a mosquitto, with paho-mqtt; kills the gateway and stops the broker.

mqtt.py PORT SCRATCH MOSQUITTO GATEWAY DEMO...: configurations are SCRATCH/*.toml, DEMO is the command of a real daemon with
a simulated person, whose station is "demo".
"""

import json
import pathlib
import queue
import signal
import ssl
import subprocess
import sys
import time

import grafana
import paho.mqtt.client as mqtt

PAGE = pathlib.Path(__file__).parent.parent / "docs/consumers/mqtt.md"
PATIENCE_S = 120
JOINTS = 22
LEVELS = {"green", "orange", "red", "above_max", "undecided"}
PHASES = {"waiting", "identifying", "monitoring", "degraded"}
# Keys that may leave the machine, and their allowed values other than null.
ALLOWED = {
    "v": lambda value: value == 1,
    "station": lambda value: value == "demo",
    "t": lambda value: abs(value - time.time()) < 60,
    "sequence": lambda value: isinstance(value, int) and value > 0,
    "phase": PHASES.__contains__,
    "withheld": lambda value: all(isinstance(reason, str) for reason in value),
    "counts": lambda value: set(value) == LEVELS and all(isinstance(count, int) for count in value.values()),
    "worst_joint": lambda value: isinstance(value, str),
    "levels": lambda value: len(value) == JOINTS and all(level in LEVELS | {None} for level in value.values()),
    "lifts": lambda value: isinstance(value, int),
}


def check(summary):
    assert set(summary) == set(ALLOWED), f"other keys than levels and counts: {sorted(summary)}"
    for key, value in summary.items():
        assert value is None or ALLOWED[key](value), f"{key}: {value}"
    assert (summary["levels"] is None) == (summary["counts"] is None)
    if summary["levels"] is None:
        assert summary["withheld"], "levels are withheld, and nothing says why"
        assert summary["worst_joint"] is None, "a worst joint without levels"
    else:
        levels = [level for level in summary["levels"].values() if level]
        assert summary["counts"] == {name: levels.count(name) for name in LEVELS}


# The station with the right certificate connects and disconnects; no other client except "demo" may publish.
LET_IN = "equipoise/certificate/"


class Watcher:
    """Everything that the broker hands on below `equipoise/`."""

    def __init__(self, port, scratch):
        self.messages, self.seen, self.payloads = queue.Queue(), [], {}
        self.client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2, client_id="watcher")
        self.client.username_pw_set("watcher", "secret")
        self.client.tls_set(ca_certs=str(scratch / "ours.pem"), tls_version=ssl.PROTOCOL_TLS_CLIENT)
        self.client.on_connect = lambda client, *_: client.subscribe("equipoise/#", qos=1)
        self.client.on_message = lambda _client, _data, message: self.messages.put(message)
        self.client.reconnect_delay_set(1, 2)
        for _ in range(100):
            try:
                self.client.connect("127.0.0.1", port, keepalive=60)
                break
            except OSError:
                time.sleep(0.1)
        self.client.loop_start()

    def next(self, left_s):
        message = self.messages.get(timeout=left_s)
        while message.topic.startswith(LET_IN):
            message = self.messages.get(timeout=left_s)
        topic, text = message.topic, message.payload.decode()
        self.seen.append(topic)
        self.payloads.setdefault(topic, []).append(text)
        assert topic in ("equipoise/demo/summary", "equipoise/demo/online"), f"{topic}: {text}"
        if topic.endswith("/summary"):
            # A dashboard that comes late must not be shown an old one.
            assert not message.retain, "a summary was retained"
            check(summary := json.loads(text))
            return summary
        return text

    def until(self, what, holds):
        end = time.monotonic() + PATIENCE_S
        while (left_s := end - time.monotonic()) > 0:
            try:
                message = self.next(left_s)
            except queue.Empty:
                break
            if holds(message):
                return message
        raise AssertionError(f"waited in vain for {what}")

    def clear(self):
        while not self.messages.empty():
            self.messages.get()


class Clock:
    """Of a station and of who reads it; `monotonic` and `time` are the time module's."""

    def __init__(self):
        self.now_s = 1000.0

    def monotonic(self):
        return self.now_s

    def time(self):
        return self.now_s + 1.7e9


def check_page():
    """The page's snippet takes what is new, nothing that a broker kept, and outlives a clock that was ahead."""
    clock, snippet = Clock(), {}
    exec(PAGE.read_text().split("```python\n")[1].split("```")[0], snippet)
    snippet["time"] = clock

    def receive(name, payload):
        message = mqtt.MQTTMessage(topic=f"equipoise/demo/{name}".encode())
        message.payload = payload.encode()
        snippet["on_message"](None, None, message)

    def summary(ahead_s, level):
        receive("summary", json.dumps({"t": clock.time() + ahead_s, "levels": {"L5S1": level}}))
        return snippet["level"]("L5S1")

    receive("online", "online")
    assert snippet["level"]("L5S1") is None, "a level before the first summary"
    assert summary(0, "green") == "green"
    assert summary(-1, "red") == "green", "one that came late took the place of a newer one"
    clock.now_s += 1
    assert summary(86_400, "red") is None, "a clock that is a day ahead"
    accepted = []
    for _ in range(10):
        clock.now_s += 1
        accepted.append(summary(0, "green"))
    assert accepted[-1] == "green", f"no summary is accepted after the clock was ahead: {accepted}"
    clock.now_s += 100
    late = [summary(-left_s, "red") for left_s in range(90, 10, -1)]
    assert not any(late), f"what a broker had kept was taken: {late}"
    receive("online", "offline")
    assert summary(0, "green") is None, "offline"
    print("mqtt: the page's snippet takes no old summary, and is not blinded by a clock that was ahead")


def resident_mib(process):
    with open(f"/proc/{process.pid}/status") as file:
        return next(int(line.split()[1]) for line in file if line.startswith("VmRSS")) / 1024


def evaluate(port, scratch, mosquitto, gateway, demo, start):
    check_page()
    broker = start("mosquitto", [mosquitto, "-c", str(scratch / "mosquitto.conf")])
    watcher = Watcher(port, scratch)

    def serve(name):
        return start(name, [gateway, "--config", str(scratch / f"{name}.toml")])

    # Who must not get in.
    refused = {
        "wrong-ca": "UnknownIssuer",
        "wrong-login": "refuses",
        "no-certificate": "cannot be reached",
    }
    strangers = {name: serve(name) for name in refused}
    right = serve("right")
    watcher.until("online", lambda message: message == "online")
    summary = watcher.until("a summary", lambda message: isinstance(message, dict))
    assert summary["withheld"] == ["daemon_silent"] and summary["levels"] is None, summary
    for name, reason in refused.items():
        end = time.monotonic() + PATIENCE_S
        while reason not in (said := (scratch / f"{name}.err").read_text()) and time.monotonic() < end:
            time.sleep(0.1)
        assert reason in said, f"{name}: {said}"
        assert "connected to the broker" not in said, f"{name} was let in"
        strangers[name].terminate()
        assert strangers[name].wait(30) == 0
    known = serve("certificate")
    end = time.monotonic() + PATIENCE_S
    while "connected to the broker" not in (scratch / "certificate.err").read_text():
        assert time.monotonic() < end, (scratch / "certificate.err").read_text()
        time.sleep(0.1)
    known.terminate()
    assert known.wait(30) == 0
    print("mqtt: another signer, a wrong password and a missing certificate are refused, the right ones let in")

    # Summaries about a person who lifts.
    start("demo", demo)
    phases, received = set(), 0

    def lifts(message):
        nonlocal received
        if isinstance(message, dict):
            phases.add(message["phase"])
            received += 1
            return message["levels"] is not None
        return False

    summary = watcher.until("levels", lifts)
    assert {"identifying", "monitoring"} <= phases, phases
    print(f"mqtt: {received} summaries of levels and counts only, then {summary['counts']}, worst {summary['worst_joint']}")

    # The gateway dies.
    right.kill()
    right.wait()
    watcher.until("the last will", lambda message: message == "offline")
    right = serve("right")
    watcher.until("online again", lambda message: message == "online")
    watcher.until("a summary again", lambda message: isinstance(message, dict))
    print("mqtt: the broker publishes the gateway's last will after SIGKILL, and the next gateway is online")

    # The broker hangs.
    before_mib = resident_mib(right)
    broker.send_signal(signal.SIGSTOP)
    time.sleep(20)
    grown_mib = resident_mib(right) - before_mib
    assert right.poll() is None
    broker.send_signal(signal.SIGCONT)
    watcher.clear()
    watcher.until("a summary after the standstill", lambda message: isinstance(message, dict))
    assert grown_mib < 5, f"the gateway grew by {grown_mib:.1f} MiB"
    print(f"mqtt: {grown_mib:.1f} MiB more after 20 s of a broker that hangs; summaries came again by themselves")

    right.terminate()
    watcher.until("a farewell", lambda message: message == "offline")
    assert right.wait(30) == 0
    lost = [line for line in (scratch / "right.err").read_text().splitlines() if "ended:" in line][-1]
    assert int(lost.split(" lost")[0].split()[-1]) > 0, f"nothing was counted as lost: {lost}"
    watcher.client.loop_stop()
    print(f"mqtt: {lost.split('ended: ')[1]}")
    shown = grafana.check_topics("demo", watcher.payloads, PAGE.read_text())
    print(f"mqtt: {shown} panels of the Grafana dashboard have data from {sum(map(len, watcher.payloads.values()))} messages")


def main(port, scratch, mosquitto, gateway, *demo):
    started = []

    def start(name, command):
        scratch_ = pathlib.Path(scratch)
        with open(scratch_ / f"{name}.out", "ab") as out, open(scratch_ / f"{name}.err", "ab") as err:
            process = subprocess.Popen(command, stdout=out, stderr=err)
        started.append(process)
        return process

    try:
        evaluate(int(port), pathlib.Path(scratch), mosquitto, gateway, demo, start)
    finally:
        for process in started:
            if process.poll() is None:
                process.send_signal(signal.SIGCONT)
                process.terminate()
        for process in started:
            try:
                process.wait(30)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


main(*sys.argv[1:])
