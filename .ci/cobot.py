"""The test of .ci/cobot: starts and kills the processes of the handover loop, and reads the cobot's speed."""

import bisect
import contextlib
import io
import itertools
import json
import math
import os
import pathlib
import random
import re
import shutil
import signal
import socket
import struct
import subprocess
import sys
import textwrap
import threading
import time

PATIENCE_S = 90
# Bound of each stop with real processes on a busy machine; in simulated time it is 0.1 s (clients/c/tests/programs/handover.rs).
STOPPED_WITHIN_S = 0.4
MOVES_M_PER_S = 0.02
RTDE_PORT = 30004


def until(what, ready, patience_s=PATIENCE_S):
    end_s = time.monotonic() + patience_s
    while True:
        value = ready()
        if value:
            return value
        assert time.monotonic() < end_s, f"after {patience_s} s still not: {what}"
        time.sleep(0.02)


class Observer(threading.Thread):
    """Speed and activity of the cobot at 500 Hz, by a connection without inputs."""

    def __init__(self, host):
        super().__init__(daemon=True)
        self.socket = socket.create_connection((host, RTDE_PORT), timeout=PATIENCE_S)
        self.file = self.socket.makefile("rb")
        assert self.ask("V", struct.pack(">H", 2)) == b"\1"
        self.ask("O", struct.pack(">d", 500.0) + b"actual_TCP_speed,output_int_register_36")
        assert self.ask("S", b"") == b"\1"
        self.speeds, self.activity = [], -1
        self.start()

    def package(self):
        size, kind = struct.unpack(">HB", self.file.read(3))
        return chr(kind), self.file.read(size - 3)

    def ask(self, kind, payload):
        self.socket.sendall(struct.pack(">HB", len(payload) + 3, ord(kind)) + payload)
        while True:
            found, answer = self.package()
            if found == kind:
                return answer

    def run(self):
        while header := self.file.read(3):
            size, kind = struct.unpack(">HB", header)
            payload = self.file.read(size - 3)
            if chr(kind) == "U":
                *speed, self.activity = struct.unpack(">6di", payload[1:])
                self.speeds.append((time.monotonic(), sum(value * value for value in speed[:3]) ** 0.5))

    def is_moving(self):
        return bool(self.speeds) and self.speeds[-1][1] > MOVES_M_PER_S

    def stopped_s(self, since_s):
        """Time from an instant to the last sample in motion before a rest of 0.2 s."""
        def rest():
            recent = [(at_s, speed) for at_s, speed in self.speeds[-2000:] if at_s >= since_s]
            moving = [at_s for at_s, speed in recent if speed > 0]
            last_s = moving[-1] if moving else since_s
            return (last_s - since_s,) if recent and recent[-1][0] - last_s > 0.2 else None
        return until("the cobot stops", rest, 10)[0]


class States(threading.Thread):
    """When the worker's state was last usable, as a consumer sees it."""

    def __init__(self):
        super().__init__(daemon=True)
        import handover
        self.stops = handover.STOPS
        self.usable_at_s = self.usable_since_s = self.reasons = None
        self.start()

    def run(self):
        import equipoise
        for reading in equipoise.subscribe("cobot", name="test", timeout_s=0.025):
            usable = bool(reading) and not reading.state.valid & self.stops
            self.reasons = reading.reason_names if reading else [reading.reason.value]
            if usable:
                self.usable_at_s = time.monotonic()
                self.usable_since_s = self.usable_since_s or self.usable_at_s
            else:
                self.usable_since_s = None
                time.sleep(0.001)

    def usable_for(self, seconds):
        since_s = self.usable_since_s
        return since_s is not None and time.monotonic() - since_s > seconds


class Plans(threading.Thread):
    """A plan that changes sides, each better than the one before, so that the cobot always moves."""

    def __init__(self, path):
        super().__init__(daemon=True)
        self.path, self.count = path, 0
        self.start()

    def run(self):
        while True:
            self.count += 1
            plan = {"position_m": [0.5, 0.3 * (-1) ** self.count, 1.1], "worst_limit_ratio": 0.9 - 1e-3 * self.count, "worst_limit_ratio_sigma": 0.0}
            new = self.path.with_suffix(".new")
            new.write_text(json.dumps(plan))
            new.rename(self.path)
            time.sleep(2.5)


class Rig:
    def __init__(self, equipoise, scratch, host, suit, plate):
        self.equipoise, self.scratch, self.host, self.suit, self.plate = equipoise, scratch, host, suit, plate
        self.running = []

    def start(self, name, *command, env=None):
        log = open(self.scratch / f"{name}.log", "ab")
        process = subprocess.Popen(command, stdout=log, stderr=log, env=env)
        self.running.append(process)
        return process

    def end(self, process, number=signal.SIGKILL):
        process.send_signal(number)
        process.wait(20)
        self.running.remove(process)

    def person(self, does):
        return self.start("person", self.equipoise, "simulate", "--suit", f"127.0.0.1:{self.suit}", "--plate",
                          f"127.0.0.1:{self.plate}", "--do", does)

    def daemon(self):
        environment = {**os.environ, "STATE_DIRECTORY": str(self.scratch / "state")}
        return self.start("daemon", self.equipoise, "run", "--config", str(self.scratch / "equipoise.toml"), env=environment)


def read_by_ur_rtde(host):
    """ur_rtde reads the cobot."""
    try:
        import rtde_receive
    except ImportError:
        return
    names = ["timestamp", "actual_q", "actual_TCP_pose", "safety_mode", "runtime_state"]
    receive = rtde_receive.RTDEReceiveInterface(host, 125.0, names)
    before_s = until("ur_rtde receives", receive.getTimestamp)
    time.sleep(0.5)
    passed_s = receive.getTimestamp() - before_s
    assert 0.3 < passed_s < 1.5, f"{passed_s} s"
    pose, joints = receive.getActualTCPPose(), receive.getActualQ()
    assert len(joints) == 6 and -0.9 < pose[0] < -0.4 and receive.getSafetyMode() == 1, (joints, pose)
    receive.disconnect()
    print("cobot: ur_rtde reads pose, joints and safety mode")


def of_one_controller(name, command, rig, observer, states, daemon, person, stops):
    """All losses with one controller. Returns the processes that replaced others."""
    times_s = {}

    def loss(what, act):
        until(f"{name}: the cobot moves before: {what}", lambda: observer.is_moving() and states.usable_for(0.1))
        time.sleep(random.uniform(0.0, 0.5))
        until(f"{name}: the cobot moves before: {what}", lambda: observer.is_moving() and states.usable_for(0.1))
        act()
        until(f"{what}: the state is lost", lambda: not states.usable_for(0.0), 10)
        # The state's change: the last usable one. States published before the act may still arrive.
        stopped_s = observer.stopped_s(states.usable_at_s)
        times_s.setdefault(what, []).append(stopped_s)

    controller = rig.start(name, *command)
    for _ in range(stops):
        loss("daemon stopped", lambda: daemon.send_signal(signal.SIGSTOP))
        daemon.send_signal(signal.SIGCONT)
    loss("suit killed", lambda: rig.end(person))
    until("the cobot retreats", lambda: observer.activity == 2, 10)
    person = rig.person("lifts")
    loss("worker loaded", lambda: subprocess.run([rig.equipoise, "subject", "load", "anon-1", "--station", "cobot"], check=True,
                                                 stdout=subprocess.DEVNULL))
    loss("daemon killed", lambda: rig.end(daemon))
    daemon = rig.daemon()
    until(f"{name}: the cobot moves again", observer.is_moving)
    at_s = time.monotonic()
    rig.end(controller)
    times_s["controller killed"] = [observer.stopped_s(at_s)]
    controller = rig.start(name, *command)
    until(f"{name}: the cobot moves again", observer.is_moving)
    time.sleep(5)
    rig.end(controller, signal.SIGTERM)
    assert controller.returncode == 0, f"{name} ended with {controller.returncode}"
    for what, values_s in times_s.items():
        values_s.sort()
        print(f"cobot: {name}: {what}: {len(values_s)} stops, p50 {1e3 * values_s[len(values_s) // 2]:.0f} ms, "
              f"maximum {1e3 * values_s[-1]:.0f} ms")
        assert values_s[-1] <= STOPPED_WITHIN_S, f"{name}: {what}: {values_s[-1]:.3f} s"
    end = [line for line in (rig.scratch / f"{name}.log").read_text().splitlines() if line.startswith("end ")][-1]
    print(f"cobot: {name}: p50/p99/p99.9/maximum: {end[4:]}")
    return daemon, person


def refused(part, attempt):
    import equipoise
    try:
        attempt()
    except equipoise.BusError as error:
        assert part in str(error), f"{part!r} is not in: {error}"
        return
    raise AssertionError(f"not refused: {part}")


def plan(**settings):
    """A plan of the daemon by the Python package."""
    import equipoise
    return equipoise.plan_handover("cobot", mass_kg=6.0, **settings)


def plan_before_identification():
    """No plan yet, and none by a client of another schema."""
    from equipoise import BusError, HandoverRefusal, _bus, _messages

    def refusal():
        try:
            return plan(timeout_s=0.5)
        except BusError:
            return None  # The daemon starts.

    until("the refusal before the identification", lambda: getattr(refusal(), "reason", None) is HandoverRefusal.NOT_IDENTIFIED)
    bus = _bus.Bus("cobot", "test", _bus.root_of_environment())
    other = _messages.HANDOVER._replace(schema="0x0000000000000001+0x0000000000000002")
    refused("cobot/handover: it was made by another version of Equipoise",
            lambda: bus.client(_messages.HandoverRequest, _messages.HandoverPlan, other))
    bus.close()


def plan_of_both(rig):
    """The Python package receives the plan that the program prints at the same time."""
    import equipoise

    def both():
        command = [rig.equipoise, "plan", "handover", "--config", str(rig.scratch / "equipoise.toml"), "--mass", "6", "--now",
                   "0.5,0,0.8", "--live", "--json"]
        printed = subprocess.run(command, capture_output=True, text=True)
        got = plan(current_m=(0.5, 0.0, 0.8), frame=equipoise.CurrentFrame.FEET)
        if printed.returncode != 0 or not got:
            return None
        theirs = json.loads(printed.stdout)
        # A handover may be measured between the two.
        return (theirs, got) if got.handovers == theirs["handovers"] else None
    printed, got = until("a plan", both)
    now = printed["now"]
    assert got.subject == printed["subject"], (got, printed)
    pairs = [(got.limit_ratio, printed["worst_limit_ratio"], got.limit_ratio_sigma),
             (got.limit_ratio_sigma, printed["worst_limit_ratio_sigma"], 0.1 * got.limit_ratio_sigma),
             (got.current_limit_ratio, now["limit_ratio"], got.current_limit_ratio_sigma),
             *((ours, theirs, 0.1) for ours, theirs in zip(got.position_m, printed["position_m"]))]
    assert all(abs(ours - theirs) <= most for ours, theirs, most in pairs), (got, printed)
    print(f"cobot: the daemon's plan by Python and by the program: {got}")


def plans_before_a_change_are_discarded():
    """Responses before the change of the worker, plans of another subject, for feet that have moved, and missing plans."""
    import equipoise
    import handover
    import handover_controller

    stderr = io.StringIO()  # There is no daemon.

    worse = (equipoise.CurrentStatus.PREDICTED, equipoise.Joint.L5S1, 0.7, 0.1)
    status, target = equipoise.CurrentStatus, handover.Plan(1, (0.4, 0.0, 1.0), 0.5, 0.1)

    def ingest(at_ns, *responses, valid=0, restarted=False, at_target=(status.NONE, None, None, None), heading_rad=0.0):
        for response in responses:
            if isinstance(response, equipoise.HandoverRefusal):
                plans._responses.put((target.at_m, equipoise.NoPlan(response, "", "d", equipoise.Reason(0))))
                continue
            subject, sample_time_ns = response
            plan = equipoise.HandoverPlan(subject, 1, sample_time_ns, 0, (sample_time_ns, 0.0, 0.0), (0.5, 0.0, 1.0),
                                          equipoise.Joint.L5S1, 0.5, 0.1, *at_target, 0.5, heading_rad)
            plans._responses.put((target.at_m, plan))
        state = equipoise.State(time_ns=at_ns, valid=valid)
        has_changed = plans.ingest(equipoise.Reading(state, at_ns, 0, None, 0, restarted, True), target)
        if plans.newest and any(plans.newest.at_m[0] == at for _, at in (r for r in responses if isinstance(r, tuple))):
            assert (plans.newest.slope_rad, plans.newest.heading_rad) == (0.5, heading_rad), plans.newest
        return has_changed, plans.newest and (plans.newest.generation, plans.newest.at_m[0])

    with contextlib.redirect_stderr(stderr):
        plans = handover_controller.DaemonPlans("without-a-daemon", 6.0, 0.35, 60.0)
        found = [
            ingest(10), ingest(20, ("a", 15)), ingest(30, valid=handover.MODEL_CHANGED), ingest(40, ("b", 25)),
            ingest(50, ("b", 35)), ingest(60, ("c", 55)), ingest(70, ("c", 65)), ingest(80, ("c", 75), restarted=True),
            ingest(90, ("d", 85)),
            ingest(100, ("d", 95), at_target=(status.PREDICTED, equipoise.Joint.L5S1, 0.6, 0.1)),
            ingest(110, ("d", 105), at_target=worse), ingest(120, ("d", 115)), ingest(130, ("d", 125), at_target=worse),
            ingest(140, ("d", 135), at_target=worse), ingest(150, ("d", 145)),
            ingest(160, ("d", 155), at_target=(status.OUT_OF_REACH, None, None, None)), ingest(170, ("d", 165)),
            ingest(180, equipoise.HandoverRefusal.INVALID), ingest(190, equipoise.HandoverRefusal.INFEASIBLE),
            ingest(200), ingest(210, ("d", 205)),
            # A heading that is not finite; feet that turn by 19 degrees, and by 21 in one and in two responses.
            ingest(220, ("d", 215), heading_rad=math.nan), ingest(230, ("d", 225), heading_rad=math.radians(19)),
            ingest(240, ("d", 235), heading_rad=math.radians(19)), ingest(250, ("d", 245), heading_rad=math.radians(-21)),
            ingest(260, ("d", 255)), ingest(270, ("d", 265), heading_rad=math.radians(-21)),
            ingest(280, ("d", 275), heading_rad=math.radians(-21)), ingest(290, ("d", 285)),
            # A gap between two states: this response is of a request before.
            ingest(10**9, ("d", 10**9 - 1)), ingest(10**9 + 10, ("e", 10**9 + 5)),
            # Without a response for three intervals.
            [ingest(10**9 + k * 10**8) for k in range(8, 1801, 8)][-1], ingest(181 * 10**9 + 5), ingest(181 * 10**9 + 6),
        ]
        plans.close()
    assert stderr.getvalue().count("no daemon runs") == 1, stderr.getvalue()
    assert found == [
        (False, None), (False, (1, 15)), (True, None), (False, None), (False, (2, 35)),
        (True, None), (False, (3, 65)), (True, None), (False, (4, 85)),
        (False, (5, 95)), (False, (6, 105)), (False, (7, 115)), (False, (8, 125)), (True, None), (False, (9, 145)),
        (True, None), (False, (10, 165)), (False, (10, 165)), (True, None), (False, None), (False, (11, 205)),
        (False, (11, 205)), (False, (12, 225)), (False, (13, 235)), (False, (14, 245)), (False, (15, 255)),
        (False, (16, 265)), (True, None), (False, (17, 285)),
        (True, None), (False, (18, 10**9 + 5)), (False, (18, 10**9 + 5)), (True, None), (False, None),
    ], found


@contextlib.contextmanager
def replaced(module, **values):
    """Replaces attributes of a module."""
    before = {name: getattr(module, name) for name in values}
    for name, value in values.items():
        setattr(module, name, value)
    try:
        yield
    finally:
        for name, value in before.items():
            setattr(module, name, value)


class Clock:
    """Replaces the module `time`: passes only by `sleep`."""

    def __init__(self):
        self.now_s = 1000.0

    def monotonic(self):
        return self.now_s

    def sleep(self, seconds):
        self.now_s += seconds


def commands_around_a_blocked_poll(blocks_s, silent_s):
    """Commands of the controller before a `poll` that reconnects and blocks, and after it.

    No state arrives meanwhile, nor for `silent_s` afterwards.
    """
    import equipoise
    import handover
    import handover_controller
    import handover_plans

    clock, stop, lost_at_s = Clock(), threading.Event(), 1002.0
    commands = {False: [], True: []}

    class Cobot:
        activity, is_able, is_held, answer_s = 1, True, False, []

        def __init__(self, address):
            self.has_blocked = False

        def poll(self):
            if not self.has_blocked and clock.now_s > lost_at_s + 0.1:
                self.has_blocked = True
                clock.sleep(blocks_s)

        def part_m(self):
            return (0.8, 0.0, 1.0) if clock.now_s < lost_at_s or self.has_blocked else None

        def send(self, output):
            commands[self.has_blocked].append(output.command)

    class Consumer:
        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def __iter__(self):
            while True:
                clock.sleep(0.01)
                now_ns = int(1e9 * clock.now_s)
                if clock.now_s > lost_at_s + 4.0:
                    stop.set()
                if 0.1 + blocks_s < clock.now_s - lost_at_s < 0.1 + blocks_s + silent_s:
                    yield equipoise.NoReading(equipoise.NoStateReason.SILENT, "")
                    continue
                state = equipoise.State(time_ns=now_ns, published_ns=now_ns, valid=handover.BELOW_LOAD_THRESHOLD)
                yield equipoise.Reading(state, now_ns, 1_000_000, None, 0, False, True)

    with replaced(handover_controller, time=clock, Cobot=Cobot), replaced(equipoise, subscribe=lambda *_, **__: Consumer()), \
            contextlib.redirect_stdout(io.StringIO()):
        handover_controller.control("s", "test", ("", 0), handover_plans.Plans("0.5,0,1", None), stop)
    return commands[False], commands[True]


def a_gap_during_a_blocked_poll_discards_the_plan():
    """After 0.9 s without a state the worker may be another: the arm holds, also if `poll` waited for most of this time."""
    import handover

    before, after = commands_around_a_blocked_poll(0.6, 0.4)
    assert handover.Command.MOVE in before, before
    assert set(after) == {handover.Command.HOLD}, f"{after.count(handover.Command.MOVE)} commands to move"
    before, after = commands_around_a_blocked_poll(0.5, 0.2)
    assert after[-1] is handover.Command.MOVE, "a shorter gap discards the plan"


def addresses_are_resolved_once():
    """A robot's name is resolved at the start, not in the control loop."""
    import handover_controller

    assert handover_controller.address_of("localhost:30004") == ("127.0.0.1", 30004)
    for wrong in ("192.0.2.20", ":30004", "192.0.2.20:x", "192.0.2.20:65536", "name.invalid:30004"):
        try:
            raise AssertionError(f"{wrong}: {handover_controller.address_of(wrong)}")
        except ValueError as error:
            assert f"{error}".startswith(f"{wrong}: "), error


def requests_continue_after_an_error():
    """An exception in a request is reported, and the thread continues."""
    import equipoise
    import handover_controller

    class Planner:
        def __init__(self, station):
            self.requests = 0

        def plan(self, **settings):
            self.requests += 1
            if self.requests < 3:
                raise RuntimeError("a fault")
            return equipoise.NoPlan(equipoise.HandoverRefusal.INVALID, "refused", "a", equipoise.Reason(0))

        def close(self):
            pass

    before, handover_controller.HandoverPlanner = handover_controller.HandoverPlanner, Planner
    stderr = io.StringIO()
    with contextlib.redirect_stderr(stderr):
        plans = handover_controller.DaemonPlans("without-a-daemon", 6.0, 0.35, 0.01)
        until("a request after an error", lambda: not plans._responses.empty(), 5)
        plans.close()
    handover_controller.HandoverPlanner = before
    assert stderr.getvalue() == "no plan: RuntimeError: a fault\nno plan: refused\n", stderr.getvalue()


def a_turn_lasts_until_the_handles_are_turned():
    """Where cobots take turns: with another target the handles also turn by what remains of the turn before."""
    import handover

    decision, part_m, turn_rad = handover.Decision(), (0.5, 0.0, 1.0), 1.2
    first = handover.Plan(1, part_m, 0.9, 0.0, 0.0, turn_rad)
    better = handover.Plan(2, part_m, 0.1, 0.0, 0.0, turn_rad + 0.1)

    def wants_until_s(from_s, plan, end_s):
        """The last time at which the part must move or turn."""
        last_s = None
        for step in range(round((end_s - from_s) / 0.01)):
            now_s = from_s + 0.01 * step
            given = handover.Input(True, part_m=part_m, plan=plan)
            last_s = now_s if decision.wants_to_move(given) else last_s
            assert (decision.decide(now_s, given).command is handover.Command.MOVE) == (now_s > 0.495), now_s
        return last_s

    # Motion begins at 0.5 s. The better plan is the target a second after 1.0 s, when most of the turn remains.
    assert wants_until_s(0.0, first, 1.0) > 0.98, "the first turn has not begun"
    last_s, turns_s = wants_until_s(1.0, better, 9.0), (turn_rad + 0.1) / handover.TURN_RAD_PER_S
    assert abs(last_s - (0.5 + turns_s)) < 0.05, f"the turn ends at {last_s:.2f} s"
    # A target with the present handles, while they are not yet turned.
    decision = handover.Decision()
    wants_until_s(0.0, first, 1.0)
    same = handover.Plan(2, part_m, 0.1, 0.0, 0.0, turn_rad)
    assert decision.wants_to_move(handover.Input(True, part_m=part_m, plan=same)), "the handles are half turned"


def no_advice_while_undecided():
    """The advice of a joint whose level is undecided is not followed."""
    import equipoise
    import handover_controller
    for level in equipoise.Level:
        state = equipoise.State(worst_joint=3)
        state.advice_direction[0], state.torque_limit_nm[3], state.joint_level[3] = 1.0, 50.0, level
        given = handover_controller.input_of(equipoise.Reading(state, 1, 0, None, 0, False, True), None, None)
        assert (given.advice is None) == (level is equipoise.Level.UNDECIDED), (level, given)


def refused_arguments(program, arguments, because):
    """The program ends with 2 and this error."""
    ended = subprocess.run([*program, *arguments], capture_output=True, text=True, timeout=PATIENCE_S)
    assert ended.returncode == 2 and because in ended.stderr, (program, arguments, ended)


def wrong_arguments_are_refused():
    """Options that one cobot and several have in common."""
    import handover_controller

    folder = pathlib.Path(handover_controller.__file__).parent
    for name, stations in [("handover_controller", ["s", "127.0.0.1:1"]), ("two_cobots", ["s=127.0.0.1:1"])]:
        program = [sys.executable, str(folder / f"{name}.py")]
        for interval in ("0", "-1", "nan", "inf"):
            refused_arguments(program, ["--mass", "6", f"--interval={interval}", *stations], "--interval")
    sources = [("--target", "0.5,0,1"), ("--plan", "plan.json"), ("--mass", "6")]
    program = [sys.executable, str(folder / "handover_controller.py"), "s", "127.0.0.1:1"]
    for first, second in itertools.permutations(sources, 2):
        refused_arguments(program, [*first, *second], "not allowed with")


def controller():
    """The Python controller without a daemon and a cobot."""
    plans_before_a_change_are_discarded()
    a_gap_during_a_blocked_poll_discards_the_plan()
    addresses_are_resolved_once()
    requests_continue_after_an_error()
    a_turn_lasts_until_the_handles_are_turned()
    no_advice_while_undecided()
    wrong_arguments_are_refused()
    print("cobot: plans without a daemon, and advice")


def of_the_daemons_plans(rig):
    """The controller moves to the place that the daemon plans, holds as the worker is loaded, and moves to a new plan."""
    log = rig.scratch / "daemon_plans.log"
    controller = rig.start("daemon_plans", sys.executable, str(rig.scratch / "handover_controller.py"), "cobot",
                           f"{rig.host}:{RTDE_PORT}", "--mass", "6", "--name", "daemon_plans")

    planned_m = []

    def moves_to_the_plan():
        planned, lines = plan(), log.read_text().splitlines()
        if planned:
            planned_m.append(planned.position_m)
        if not lines or "command=move" not in lines[-1]:
            return False
        target_m = [float(value) for value in re.search(r"target_m=(\S+)", lines[-1]).group(1).split(",")]
        # The plan differs a little with each request: the feet are measured.
        return any(all(abs(target - at) < 0.05 for target, at in zip(target_m, at_m)) for at_m in planned_m)

    until("the daemon's plan is the target", moves_to_the_plan)
    planned_m.clear()
    load_at_s = time.monotonic()
    subprocess.run([rig.equipoise, "subject", "load", "anon-1", "--station", "cobot"], check=True, stdout=subprocess.DEVNULL)

    def held():
        lines = [line for line in log.read_text().splitlines() if "command=hold" in line]
        return bool(lines) and float(lines[-1].split()[0].removeprefix("at_s=")) > load_at_s

    until("the controller holds as the worker is loaded", held, 10)
    until("a new plan is the target", moves_to_the_plan)
    rig.end(controller, signal.SIGTERM)
    assert controller.returncode == 0, f"the controller ended with {controller.returncode}"
    print("cobot: python: moves to the daemon's plans, and holds as the worker is loaded")


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


def second_station(rig):
    """A copy of the first station with devices and state of its own."""
    scratch = rig.scratch / "second"
    scratch.mkdir()
    shutil.copytree(rig.scratch / "state", scratch / "state")
    suit, plate = free_port(), free_port()
    text = (rig.scratch / "equipoise.toml").read_text().replace('station = "cobot"', 'station = "cobot-2"')
    text = text.replace(f"127.0.0.1:{rig.suit}", f"127.0.0.1:{suit}").replace(f"127.0.0.1:{rig.plate}", f"127.0.0.1:{plate}")
    (scratch / "equipoise.toml").write_text(text)
    second = Rig(rig.equipoise, scratch, None, suit, plate)
    second.running = rig.running  # Ended together.
    return second


def of_two_cobots(rig, daemon):
    """One cobot moves at a time; without a state of its worker its turn ends, and it resumes later."""
    before = len(rig.running)
    second = second_station(rig)
    second.person("lifts")
    daemons = {"cobot": daemon, "cobot-2": second.daemon()}
    hosts = {"cobot": "127.0.31.5", "cobot-2": "127.0.31.6"}
    for host in hosts.values():
        rig.start(f"cobot-{host}", rig.equipoise, "simulate", "--cobot", f"{host}:{RTDE_PORT}")
    observers = {station: until("the cobot serves", lambda host=host: connected(host)) for station, host in hosts.items()}
    controller = rig.start("two", sys.executable, str(rig.scratch / "two_cobots.py"), "--mass", "6",
                           *(f"{station}={host}:{RTDE_PORT}" for station, host in hosts.items()))
    first = until("a cobot moves", lambda: next((at for at, seen in observers.items() if seen.is_moving()), None), 240)
    other = next(station for station in hosts if station != first)
    daemons[first].send_signal(signal.SIGSTOP)
    until(f"{other} moves while the daemon of {first} is stopped", observers[other].is_moving)
    daemons[first].send_signal(signal.SIGCONT)
    until(f"{first} resumes", observers[first].is_moving)
    for station in hosts:
        command = [rig.equipoise, "latency", "--station", station, "--for", "5"]
        for line in subprocess.run(command, capture_output=True, text=True).stdout.splitlines():
            stage, p50, _, p99, *_ = *line.split(), "", "", ""
            if stage in ("loop.wake", "loop.compute", "suit.to_state"):
                print(f"cobot: two stations: {station}: {stage}: p50 {p50} us, p99 {p99} us")
    rig.end(controller, signal.SIGTERM)
    assert controller.returncode == 0, f"two_cobots.py ended with {controller.returncode}"
    moving = {at: [at_s for at_s, speed in seen.speeds if speed > MOVES_M_PER_S] for at, seen in observers.items()}
    together = sum(near(moving[other], at_s) for at_s in moving[first])
    assert all(moving.values()) and together == 0, f"both moved at {together} instants"
    print(f"cobot: two cobots: {len(moving[first])} and {len(moving[other])} samples in motion, none at the same time")
    for process in rig.running[before:]:
        rig.end(process)


def near(ordered, value):
    """Whether one of these increasing values is within 10 ms of a value."""
    at = bisect.bisect(ordered, value)
    return any(abs(ordered[k] - value) < 0.01 for k in (at - 1, at) if 0 <= k < len(ordered))


def loop(equipoise, scratch, host, suit, plate, stops):
    scratch = pathlib.Path(scratch)
    rig = Rig(equipoise, scratch, host, suit, plate)
    try:
        rig.start("cobot", equipoise, "simulate", "--cobot", f"{host}:{RTDE_PORT}")
        observer = until("the cobot serves", lambda: connected(host))
        read_by_ur_rtde(host)
        controller()
        refused("no daemon runs on this station", plan)
        person, daemon = rig.person("poses"), rig.daemon()
        plan_before_identification()
        states = States()
        until("the worker is identified", lambda: states.usable_for(1.0), 240)
        rig.end(person)
        person = rig.person("lifts")
        plan_of_both(rig)
        of_the_daemons_plans(rig)
        of_two_cobots(rig, daemon)
        file = scratch / "plan.json"
        Plans(file)
        # Two sources of the target.
        refused_arguments([str(scratch / "handover_controller")], ["cobot", f"{host}:{RTDE_PORT}", "--target", "0.5,0,1",
                                                                   "--plan", str(file)], "[--target X,Y,Z | --plan FILE]")
        for name, program in [("python", [sys.executable, str(scratch / "handover_controller.py")]),
                              ("cpp", [str(scratch / "handover_controller")])]:
            command = [*program, "cobot", f"{host}:{RTDE_PORT}", "--plan", str(file), "--name", name]
            daemon, person = of_one_controller(name, command, rig, observer, states, daemon, person, int(stops))
    finally:
        for process in rig.running:
            process.send_signal(signal.SIGCONT)
            process.kill()
            process.wait()


def connected(host):
    try:
        return Observer(host)
    except OSError:
        return None


def matrix(turn):
    """The matrix of a rotation vector, by Rodrigues' formula."""
    angle = math.sqrt(sum(value * value for value in turn))
    x, y, z = (value / angle for value in turn) if angle > 1e-12 else (0.0, 0.0, 0.0)
    cross = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
    squared = product(cross, cross)
    return [
        [float(i == j) + math.sin(angle) * cross[i][j] + (1.0 - math.cos(angle)) * squared[i][j] for j in range(3)]
        for i in range(3)
    ]


def product(first, second):
    return [[sum(first[i][k] * second[k][j] for k in range(3)) for j in range(3)] for i in range(3)]


def vector(turn):
    """The rotation vector of a matrix; turns by 180 degrees do not occur."""
    along = [turn[2][1] - turn[1][2], turn[0][2] - turn[2][0], turn[1][0] - turn[0][1]]
    sine = 0.5 * math.sqrt(sum(value * value for value in along))
    angle = math.atan2(sine, 0.5 * (turn[0][0] + turn[1][1] + turn[2][2] - 1.0))
    return [0.5 * value * (angle / sine if sine > 1e-12 else 1.0) for value in along]


def pose_trans(first, second):
    turn = matrix(first[3:])
    at = [first[i] + sum(turn[i][k] * second[k] for k in range(3)) for i in range(3)]
    return at + vector(product(turn, matrix(second[3:])))


def pose_inv(pose):
    turn = [list(column) for column in zip(*matrix(pose[3:]))]
    return [-sum(turn[i][k] * pose[k] for k in range(3)) for i in range(3)] + vector(turn)


class Halted(Exception):
    """The robot's program has halted."""


class Robot:
    """The robot's program as Python, on a TCP that follows its velocity exactly; `settings` replace those of the script."""

    STEP_S = 0.002

    def __init__(self, path, **settings_of_test):
        self.inputs, self.outputs = {}, {}
        self.base = [1.15, 0.0, 0.75]
        self.tcp = [-0.35 - 0.3, 0.0, 0.35, -1.2092, -1.2092, 1.2092]
        self.world = {
            "p": lambda *values: list(values),
            "read_input_integer_register": lambda number: self.inputs.get(("int", number), 0),
            "read_input_float_register": lambda number: self.inputs.get(("double", number), 0.0),
            "write_output_integer_register": lambda number, value: self.outputs.update({("int", number): value}),
            "write_output_float_register": lambda number, value: self.outputs.update({("double", number): value}),
            "get_steptime": lambda: self.STEP_S,
            "get_actual_tcp_pose": lambda: list(self.tcp),
            # Not a number for an infinite value, as those of C.
            "sin": lambda angle: math.sin(angle) if math.isfinite(angle) else math.nan,
            "cos": lambda angle: math.cos(angle) if math.isfinite(angle) else math.nan,
            "atan2": math.atan2,
            "norm": lambda values: sum(value * value for value in values) ** 0.5,
            "pose_inv": pose_inv,
            "pose_trans": pose_trans,
            "popup": lambda *_, **__: None,
            "Halted": Halted,
        }
        lines = [line for line in textwrap.dedent(pathlib.Path(path).read_text()).split("\n") if line.strip() != "end"]
        body = textwrap.dedent("\n".join(lines[lines.index("def equipoise_handover():") + 1:]))
        body = re.sub(r"\bp\[", "[", body)
        settings, body = re.split(r"(?=^thread )", body, maxsplit=1, flags=re.MULTILINE)
        functions = re.split(r"^rtde_set_watchdog", body, flags=re.MULTILINE)[0]
        functions = functions.replace("thread ", "def ").replace("sync()", "yield").replace("local ", "")
        names = ", ".join(re.findall(r"^(handover_\w+) =", settings, flags=re.MULTILINE))
        functions = re.sub(r"^(def .*:)$", rf"\1\n  global {names}", functions, flags=re.MULTILINE)
        functions = re.sub(r"^( *)halt$", r"\1raise Halted()", functions, flags=re.MULTILINE)
        settings += "".join(f"{name} = {value}\n" for name, value in settings_of_test.items())
        exec(settings + functions, self.world)  # pylint: disable=exec-used
        self.watch = self.world["handover_watch"]()

    def run(self, seconds, is_alive):
        for step in range(round(seconds / self.STEP_S)):
            if is_alive and step % 4 == 0:
                self.inputs["int", 37] = self.inputs.get(("int", 37), 0) + 1
            next(self.watch)
            activity = self.world["handover_activity"]()
            self.world["handover_report"](activity)
            self.velocity = self.world["handover_velocity"](activity)
            step = [self.STEP_S * velocity for velocity in self.velocity]
            turned = pose_trans([0.0, 0.0, 0.0, *step[3:]], [0.0, 0.0, 0.0, *self.tcp[3:]])
            self.tcp = [at + by for at, by in zip(self.tcp[:3], step[:3])] + turned[3:]
            assert self.world["norm"](self.velocity[:3]) <= 0.15 + 1e-9
            assert self.world["norm"](self.velocity[3:]) <= 0.3 + 1e-9
        return activity

    def speed(self):
        return self.world["norm"](self.velocity[:3])


def turns(path):
    """Slopes and headings of the handles, by the test vectors."""
    count = 0
    for line in pathlib.Path("clients/handover_vectors.txt").read_text().splitlines():
        if not line.startswith("turn "):
            continue
        given, expected = line.removeprefix("turn ").split(" => ")
        slope, heading, level_heading = map(float, given.split())
        robot = Robot(path, HANDOVER_LEVEL_HEADING_RAD=level_heading)
        target = {("double", 36 + axis): value for axis, value in enumerate([0.45, 0.1, 1.1, slope, heading])}
        robot.inputs, level, count = {("int", 36): 1, **target}, matrix(robot.tcp[3:]), count + 1
        activity = robot.run(12, True)
        if expected == "outside":
            assert activity == 3 and robot.tcp[3:] == [-1.2092, -1.2092, 1.2092], f"{activity}, {robot.tcp} for {line}"
            continue
        turned = product(product(matrix(robot.tcp[3:]), list(zip(*level))), matrix([0.0, 0.0, level_heading]))
        found = [turned[axis][column] for column in (0, 1) for axis in range(3)]
        wanted = [float(word) for word in re.split("[ ,]", expected)]
        assert activity == 1 and all(abs(a - b) < 1e-3 for a, b in zip(found, wanted)), f"{activity}, {found} for {line}"
    assert count >= 9, f"only {count} turns"


def script(path):
    """The same behaviour as the simulated program (simulator/src/cobot/program.rs)."""
    robot = Robot(path)
    target = [0.45, 0.1, 1.1]
    robot.inputs = {("int", 36): 1, ("int", 37): 77, **{("double", 36 + axis): target[axis] for axis in range(3)}}
    robot.inputs["double", 39] = slope = 0.5
    level = matrix(robot.tcp[3:])
    assert robot.run(1, False) == 4 and robot.speed() == 0, "a command from before the start moves it"
    assert robot.run(0.39, True) == 4 and robot.speed() == 0, "it moves before the sequence has settled"
    assert robot.run(0.5, True) == 1 and robot.speed() > 0.1, "it does not move"
    assert robot.run(0.05, False) == 1, "one late package stops it"
    assert robot.run(0.02, False) == 4 and robot.speed() == 0, "it moves without a heartbeat"
    robot.run(10, True)
    reported = [robot.outputs["double", 36 + axis] for axis in range(3)]
    assert all(abs(a - b) < 1e-3 for a, b in zip(reported, target)), f"{reported}, not {target}"
    assert robot.outputs["int", 37] == robot.inputs["int", 37]
    turned = vector(product(matrix(robot.tcp[3:]), list(zip(*level))))
    assert all(abs(a - b) < 1e-3 for a, b in zip(turned, [0.0, slope, 0.0])), f"turned by {turned}, not {slope}"
    robot.inputs["double", 36] = 0.45 + 0.1
    for wrong in (1.21, -1.21, math.nan):
        robot.inputs["double", 39] = wrong
        assert robot.run(0.1, True) == 3 and not any(robot.velocity), f"it moves with a slope of {wrong}"
    robot.inputs["double", 39] = -1.2
    assert robot.run(0.1, True) == 1 and robot.speed() > 0.05, "it does not move with the smallest slope"
    for wrong in (0.0, math.nan):
        robot.inputs["double", 36] = wrong
        assert robot.run(0.1, True) == 3 and not any(robot.velocity), "it moves to a target outside the workspace"
    robot.inputs["double", 39] = math.nan
    robot.inputs["int", 36] = 2
    assert robot.run(0.1, True) == 2 and robot.speed() > 0.1, "it does not retreat"
    robot.inputs["int", 36] = 0
    assert robot.run(0.1, True) == 0 and robot.speed() == 0, "it does not hold"
    try:
        Robot(path, HANDOVER_RETREAT_M=[0.7, -0.174, 1.5])
        raise AssertionError("it starts with a retreat position outside the workspace")
    except Halted:
        pass
    retreat, robot.world["HANDOVER_RETREAT_M"] = robot.world["HANDOVER_RETREAT_M"], [0.7, -0.174, 1.5]
    robot.inputs["int", 36] = 2
    assert robot.run(0.1, True) == 3 and not any(robot.velocity), "it retreats to a position outside the workspace"
    robot.world["HANDOVER_RETREAT_M"] = retreat
    assert robot.run(0.1, True) == 2, "it does not retreat"
    robot.inputs["int", 36], robot.inputs["double", 36], robot.inputs["double", 39], robot.inputs["double", 40] = 1, 0.45, 0.5, 0.5
    assert robot.run(5, True) == 1
    robot.inputs["int", 36] = 2
    robot.run(10, True)
    turned = vector(product(matrix(robot.tcp[3:]), list(zip(*level))))
    assert all(abs(value) < 1e-3 for value in turned), f"turned by {turned} at its retreat position"
    turns(path)
    print("cobot: the robot's program moves, holds, retreats, and holds without a heartbeat")


def rtde_client(host, port):
    """Sends `hold` each 8 ms by the client of the Python controller, as .ci/cobot-rtde.cpp does."""
    import handover
    import handover_rtde
    cobot = handover_rtde.Cobot((host, int(port)))
    while True:
        cobot.poll()
        cobot.send(handover.Output(handover.Command.HOLD, (0.0, 0.0, 0.0)))
        time.sleep(0.008)


class Peer:
    """A robot that accepts one connection of a client."""

    def __init__(self, command):
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.listener.settimeout(10)
        address = [str(value) for value in self.listener.getsockname()]
        self.client = subprocess.Popen([*command, *address], stderr=subprocess.DEVNULL)
        self.socket, self.received = self.listener.accept()[0], b""
        self.accepted_s = time.monotonic()

    def send(self, kind, payload):
        self.socket.sendall(struct.pack(">HB", len(payload) + 3, ord(kind)) + payload)

    def package(self, within_s):
        """The next package, None after this time."""
        end_s = time.monotonic() + within_s
        while len(self.received) < 3 or len(self.received) < int.from_bytes(self.received[:2], "big"):
            self.socket.settimeout(max(end_s - time.monotonic(), 1e-3))
            try:
                received = self.socket.recv(4096)
            except TimeoutError:
                return None
            assert received, "it closed the connection without a reset: queued commands would arrive later"
            self.received += received
        size = int.from_bytes(self.received[:2], "big")
        kind, self.received = chr(self.received[2]), self.received[size:]
        return kind

    def close(self):
        self.client.kill()
        self.client.wait()
        self.socket.close()
        self.listener.close()


def rtde(*cpp):
    """The RTDE clients of both controllers with a robot that is silent, and one that never ends the handshake."""
    output = struct.pack(">BiidddiI", 1, 0, 0, 0.0, 0.0, 0.0, 1, 2)
    for name, command in [("python", [sys.executable, __file__, "rtde-client"]), ("cpp", cpp)]:
        peer = Peer(command)
        for answer in (b"\x01", b"\x01", b"\x01", b"\x01"):
            kind = peer.package(5)
            peer.send(kind, answer)
        sent = 0
        for _ in range(125):
            peer.send("U", output)
            sent += peer.package(0.004) == "U"
        silent_s = last_s = time.monotonic()
        assert sent > 25, f"{name}: {sent} commands in 0.5 s"
        try:
            while time.monotonic() < silent_s + 2:
                if peer.package(0.01):
                    last_s = time.monotonic()
            raise AssertionError(f"{name}: it keeps the connection to a silent robot")
        except ConnectionResetError:
            left_s = time.monotonic() - silent_s
        assert last_s - silent_s < 0.2, f"{name}: it sends {last_s - silent_s:.3f} s after the last output"
        assert 0.2 < left_s < 0.6, f"{name}: it closes the connection after {left_s:.3f} s of silence"
        peer.close()

        peer = Peer(command)
        with contextlib.suppress(ConnectionResetError, BrokenPipeError):
            while time.monotonic() < peer.accepted_s + 5:
                peer.send("M", b"text")
                time.sleep(0.02)
        left_s = time.monotonic() - peer.accepted_s
        assert left_s < 1.2, f"{name}: a handshake without an end lasts {left_s:.1f} s"
        peer.close()
    print("cobot: both RTDE clients leave a silent robot, and a handshake without an end")


def main():
    what, *rest = sys.argv[1:]
    {"script": script, "loop": loop, "rtde": rtde, "rtde-client": rtde_client, "controller": controller}[what](*rest)


if __name__ == "__main__":
    try:
        main()
    except AssertionError as error:
        sys.exit(f"cobot: {error}")
