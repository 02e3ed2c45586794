"""The Python package on a bus of its own: clients-python.py ROOT. Here this program publishes.

It does what a daemon that runs well does not: it is silent, its clock is ahead, its sensors give less; and consumers are
slower than the loop, are closed, or are killed.
"""

import contextlib
import glob
import os
import shutil
import subprocess
import sys
import threading
import time

import equipoise
from equipoise import CurrentFrame, CurrentStatus, HandoverRefusal, Joint
from equipoise import Unavailable, ConsumerReceipt, Reason, State, NoStateReason, _arrays, _bus, _messages

STATION = "alone"
# As old as no state here becomes, so that a machine that stands still changes nothing.
ANY_AGE_S = 3600.0
# A consumer rejoins after 2 s of silence.
LONGER_THAN_REJOIN_S = 2.2
HANGS_AFTER_S = 30
# Fields that no reason withholds and that are available in every state.
ALWAYS_VALID = {
    "cycle", "time_ns", "group_delay_ns", "valid", "phase", "static_pose", "converged", "poses_used", "stance",
    "motion_samples_used", "lifts", "body_source", "foot_outline_source", "body_rejected", "unavailable", "dose_damage",
    "dose_probability", "fatigue", "published_ns",
}


class Publisher:
    """Publishes states as the daemon does."""

    def __init__(self, root):
        self._bus = _bus.Bus(STATION, "daemon", root)
        self._states = self._bus.publisher(State, _messages.STATE)
        self._cycle = 0

    def publish(self, ahead_s=0):
        self._cycle += 1
        now_ns = time.monotonic_ns()
        self._states.send_copy(State(cycle=self._cycle, time_ns=now_ns + ahead_s * 10**9, published_ns=now_ns))

    def close(self):
        self._states.delete()
        self._bus.close()


def until(what, holds):
    end = time.monotonic() + HANGS_AFTER_S
    while not holds():
        assert time.monotonic() < end, f"waited too long until {what}"
        time.sleep(0.01)


def joined(root, name, **settings):
    return equipoise.subscribe(STATION, name=name, root=root, stale_after_s=ANY_AGE_S, **settings)


def a_polling_consumer_reports(root, publisher):
    """Each finds a state at once, ten periods after the one before."""
    bus = _bus.Bus(STATION, "reports", root)
    reports = bus.subscriber(ConsumerReceipt, _messages.CONSUMER_RECEIPT, 16)
    ways = {"slow-next": lambda consumer: consumer.next(0.0), "slow-latest": lambda consumer: consumer.latest()}
    for name, read in ways.items():
        with joined(root, name) as consumer:

            def is_reported():
                publisher.publish()
                assert read(consumer), f"{name}: no state"
                return reports.receive() is not None

            until(f"{name} reports", is_reported)
        while reports.receive() is not None:
            pass  # Its last word.
    reports.delete()
    bus.close()


def a_seldom_polling_consumer_reads(root, publisher):
    with joined(root, "seldom", report=False) as consumer:
        for _ in range(2):
            time.sleep(LONGER_THAN_REJOIN_S)
            publisher.publish()
            reading = consumer.latest()
            assert reading and reading.is_new, f"asked every {LONGER_THAN_REJOIN_S} s: {reading}"


def a_polling_consumer_rejoins(root, publisher):
    """The bus's directory goes, as `systemctl stop` removes it; a publisher comes later."""
    with joined(root, "polls", report=False) as consumer:
        publisher.publish()
        assert consumer.next(0.0)
        while consumer.next(0.0):
            pass  # With the last state of the test before.
        publisher.close()
        shutil.rmtree(root)

        def has_rejoined():
            assert not consumer.next(0.0), "a state without a publisher"
            return os.path.isdir(root)

        until("a polling consumer recreates the bus", has_rejoined)
        publisher = Publisher(root)

        def is_read():
            publisher.publish()
            return bool(consumer.next(0.0))

        until("a consumer that never waits finds the new bus", is_read)
    return publisher


def a_lost_bus_is_reported_until_it_is_read_again(root, publisher):
    """Between the attempts to rejoin it is not reported as a silence of the daemon."""
    with joined(root, "lost", report=False) as consumer:
        station, name, _, depth = where = consumer._where
        consumer._where = station, name, "not absolute", depth
        reads = (lambda: consumer.next(0.0), consumer.latest, consumer.early)
        while consumer.latest():
            consumer._last = None  # It may be of any age here.
        until("the bus is lost", lambda: consumer.next(0.0).reason is NoStateReason.BUS)
        end_s = time.monotonic() + LONGER_THAN_REJOIN_S
        while time.monotonic() < end_s:
            for read in reads:
                lost = read()
                assert not lost and lost.reason is NoStateReason.BUS and "cannot keep the bus" in lost.text, lost
            time.sleep(0.02)
        consumer._where = where

        def is_read():
            publisher.publish()
            return bool(consumer.next(0.0))

        until("the bus is read again", is_read)


def a_clock_ahead_blocks_no_consumer(root, publisher):
    with joined(root, "ahead") as consumer:
        publisher.publish()
        assert consumer.latest()
        states = consumer.receipt_report.states
        publisher.publish(ahead_s=3600)
        refused = consumer.next(1.0)
        assert not refused and refused.reason is NoStateReason.OTHER_CLOCK, refused
        again = consumer.next(0.0)
        assert not again and again.reason is NoStateReason.OTHER_CLOCK, f"between two refused states: {again}"
        publisher.publish()
        reading = consumer.next(1.0)
        assert reading, f"after one state from a clock ahead: {reading}"
        assert consumer.receipt_report.states == states + 1, "a state from ahead was counted"


def a_stale_state_is_reported(root, publisher):
    with equipoise.subscribe(STATION, name="hasty", root=root, stale_after_s=0.0, report=False) as consumer:
        publisher.publish()
        for read in (lambda: consumer.next(0.0), consumer.latest):
            publisher.publish()
            refused = read()
            assert not refused and refused.reason is NoStateReason.STALE, refused
        # States arrive, so the consumer must not rejoin.
        ports = consumer._ports
        time.sleep(LONGER_THAN_REJOIN_S)
        publisher.publish()
        assert consumer.next(0.0).reason is NoStateReason.STALE and consumer._ports is ports, "it rejoined although states arrive"


def states_keep_a_consumer_of_early_states_joined(root, publisher):
    with joined(root, "early", report=False) as consumer:
        ports, end = consumer._ports, time.monotonic() + 2 * LONGER_THAN_REJOIN_S
        while time.monotonic() < end:
            publisher.publish()
            assert not consumer.early(), "nothing publishes early states"
            time.sleep(0.02)
        assert consumer._ports is ports, "it rejoined although states arrive"


def closed_consumers_stay_closed(root, publisher):
    consumer = joined(root, "closed")
    consumer.close()
    consumer.close()
    publisher.publish()
    for read in (lambda: consumer.next(0.0), consumer.latest, lambda: next(iter(consumer))):
        try:
            said = read()
        except equipoise.BusError as error:
            assert "closed" in str(error), error
        else:
            raise AssertionError(f"a closed consumer read: {said}")


def child(what, root, *more):
    command = [sys.executable, __file__, what, root, *more]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


@contextlib.contextmanager
def ended(process):
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def killed_reader(root, publisher, count):
    """A process with so many consumers is killed; the names of the shared memory that it read through."""
    pattern = f"/dev/shm/{_bus.shared_memory_prefix(root)}*.connection"
    before = set(glob.glob(pattern))
    with ended(child("hold", root, str(count))) as reader:
        assert reader.stdout.readline() == "joined\n", "the child did not join"
        publisher.publish()
        return set(glob.glob(pattern)) - before


def leftovers_hang_no_consumer(root, publisher):
    """Memory without a size, which iceoryx2 waits for ever to get one, if it clears its dead maker away."""
    empty = killed_reader(root, publisher, 1)
    assert empty, "the child had no connection"
    for path in empty:
        os.remove(path)  # Not cut short: this program has it open.
        open(path, "x").close()
    with ended(child("hold", root, "1")) as other:
        try:
            out, _ = other.communicate("", timeout=HANGS_AFTER_S)
        except subprocess.TimeoutExpired:
            raise AssertionError("a consumer hangs as it joins, because another was killed") from None
        assert out == "joined\n", out
    for path in empty:
        os.remove(path)


def slots_of_dead_processes_are_awaited(root, publisher):
    """A consumer removes no resources of dead processes; it waits until the daemon's housekeeping has done so."""
    killed_reader(root, publisher, 2)
    crowd = []
    try:
        for at in range(_messages.LISTENERS_MAX):
            crowd.append(joined(root, f"crowd-{at}", report=False))
    except equipoise.BusError as error:
        assert "are taken" in str(error), error
    else:
        raise AssertionError("the places of the dead were free at once")
    with ended(child("clear", root)) as housekeeping:
        assert housekeeping.stdout.readline() == "ready\n"
        crowd.append(joined(root, "patient", report=False))
    for consumer in crowd:
        consumer.close()


def reading_of(**fields):
    state = State(cycle=1, suit_sample_time_ns=1, suggested_pose=1, **fields)
    for name, kind in State._fields_:
        if name.startswith(("pred", "nis", "prior", "var")) or name.endswith(("sigma_n", "sigma_s", "sigma_m")):
            setattr(state, name, 1.0 if isinstance(getattr(state, name), float) else kind(*[1.0] * kind._length_))
    state.advice_direction[0] = 1.0
    return equipoise.Reading(state, 1, 0, None, 0, False, True)


def what_is_unavailable_is_no_number():
    whole, names = reading_of(), [name for name, _ in State._fields_]
    assert set(_arrays.INVALIDATED_BY) | set(_arrays.AVAILABLE_IF) | ALWAYS_VALID == set(names), "a field without a validity rule"
    for name in names:
        assert whole.array(name) is not None, f"{name} is withheld from a state that says all"
    invalid = reading_of(valid=2**64 - 1)
    for name in set(_arrays.INVALIDATED_BY):
        assert invalid.array(name) is None, f"{name} under every reason"
    silent = equipoise.Reading(
        State(suit_age_ns=2**64 - 1, ground_age_ns=2**64 - 1, suggested_pose=2**32 - 1), 1, 0, None, 0, False, True
    )
    for name in set(_arrays.AVAILABLE_IF) - {"suit_com_m", "ground_force_n"}:
        assert silent.array(name) is None, f"{name}, which the state does not say: {silent.array(name)}"
    for name, reason in {"sharing_source": Reason.GROUND_STALE, "acceleration_source": Reason.BODY_UNKNOWN, "suit_com_m": Reason.POSITION_UNKNOWN}.items():
        assert reading_of(valid=int(reason)).array(name) is None, name
    no_com, no_shear = reading_of(unavailable=int(Unavailable.SUIT_COM)), reading_of(unavailable=int(Unavailable.SHEAR))
    assert no_com.array("suit_com_m") is None and no_shear.array("suit_com_m") is not None
    assert no_shear.array("ground_force_n") is None and no_com.array("ground_force_n") is not None
    no_shear.state.ground_force_n[2] = 700.0
    assert no_shear.ground_force_up_n == 700.0 and invalid.ground_force_up_n is None
    frame = equipoise.to_pandas([silent])
    assert frame["delta_f_sigma_n"].isna().all() and not frame["fatigue_l5s1"].isna().any(), frame


def planned(root, answer, **settings):
    """The result of a request that a server in this program answers."""
    bus, row = _bus.Bus(STATION, "planner", root), _messages.HANDOVER
    factory = bus._exchange(_messages.HandoverRequest, _messages.HandoverPlan, row)
    server = factory.server_builder().create()
    results = []

    def ask():
        try:
            results.append(equipoise.plan_handover(STATION, root=root, mass_kg=6.0, timeout_s=HANGS_AFTER_S, **settings))
        except Exception as error:
            results.append(error)

    client = threading.Thread(target=ask)
    client.start()
    while client.is_alive():
        request = server.receive()
        if request is not None:
            request.send_copy(answer(request.payload().contents))
            request.delete()
        time.sleep(0.001)
    client.join()
    server.delete()
    bus.close()
    return results[0]


def refused(part, attempt):
    try:
        attempt()
    except equipoise.BusError as error:
        assert part in str(error), f"{part!r} is not in: {error}"
        return
    raise AssertionError(f"not refused: {part}")


def plans_are_requested(root):
    """The response as a typed result; each refusal; a server that is missing, silent, or of another schema."""
    requests = []

    def plan(request):
        current = (request.current_frame, request.current_is_sloped, request.current_slope_rad)
        requests.append((request.mass_kg, request.width_m, list(request.current_m), *current))
        answer = _messages.HandoverPlan(cycle=7, sample_time_ns=8, handovers=2, worst_joint=Joint.L5S1, limit_ratio=0.4)
        answer.subject[:3] = b"a-1"
        answer.position_m[:], answer.place_m[:] = (2.0, 0.5, 1.1), (0.5, 0.1, 1.1)
        answer.current_status, answer.current_limit_ratio = CurrentStatus.PREDICTED, 0.6
        return answer

    got = planned(root, plan, current_m=(0.5, 0.0, 0.8), frame=CurrentFrame.FEET, current_slope_rad=0.5)
    assert requests == [(6.0, 0.35, [0.5, 0.0, 0.8], 2, 1, 0.5)], requests
    assert got and (got.subject, got.cycle, got.sample_time_ns, got.handovers) == ("a-1", 7, 8, 2), got
    assert (got.position_m, got.place_m, got.worst_joint) == ((2.0, 0.5, 1.1), (0.5, 0.1, 1.1), Joint.L5S1), got
    assert (got.limit_ratio, got.current_limit_ratio, got.current_worst_joint) == (0.4, 0.6, Joint(0)), got
    far = planned(root, lambda request: _messages.HandoverPlan(current_status=CurrentStatus.OUT_OF_REACH))
    assert far.current_status is CurrentStatus.OUT_OF_REACH and far.current_limit_ratio is None, far
    texts = set()
    for reason in list(HandoverRefusal)[1:]:
        refusal = planned(root, lambda request: _messages.HandoverPlan(refused=reason, valid=Reason.POSITION_UNKNOWN))
        assert not refusal and refusal.reason is reason and refusal.reasons is Reason.POSITION_UNKNOWN, repr(refusal)
        texts.add(refusal.text)
    assert len(texts) == len(HandoverRefusal) - 1, texts
    unknown = planned(root, lambda request: _messages.HandoverPlan(refused=99))
    assert isinstance(unknown, equipoise.BusError) and "run the same release" in str(unknown), unknown

    with equipoise.HandoverPlanner(STATION, root=root, timeout_s=0.1) as planner:
        for wrong in ({"current_m": (0.5, 0.0, 0.8)}, {"frame": CurrentFrame.FEET}):
            try:
                raise AssertionError(f"planned with {wrong}: {planner.plan(mass_kg=6.0, **wrong)}")
            except ValueError:
                pass
        for _ in range(2):
            refused("no daemon runs on this station", lambda: planner.plan(mass_kg=6.0))
        bus = _bus.Bus(STATION, "planner", root)
        server = bus._exchange(_messages.HandoverRequest, _messages.HandoverPlan, _messages.HANDOVER).server_builder().create()
        # More than may be in flight.
        for _ in range(_messages.HANDOVER.active_requests_max + 1):
            refused("did not answer on equipoise/alone/handover within 100 ms", lambda: planner.plan(mass_kg=6.0))
        other = _messages.HANDOVER._replace(schema="0x0000000000000001+0x0000000000000002")
        refused("handover: it was made by another version", lambda: bus.client(_messages.HandoverRequest, _messages.HandoverPlan, other))
        server.delete()
        bus.close()
    refused("closed", lambda: planner.plan(mass_kg=6.0))


def errors_of_opening_have_a_remedy():
    """Each error of iceoryx2 as it opens a service; no service is made with other settings if only the attempt failed."""
    errors = {
        "OpenError(IncompatibleTypes)": "it was made by another version", "OpenError(HangsInCreation)": "its files are damaged",
        "CreateError(InternalFailure)": "if it persists", "OpenError(Interrupt)": "if it persists",
        "OpenError(InsufficientPermissions)": "it belongs to another user",
        "OpenError(DoesNotSupportRequestedAmountOfNodes)": "it was made with other settings",
    }
    bus = _bus.Bus.__new__(_bus.Bus)
    bus._root = "/run/bus"
    for error, remedy in errors.items():
        text = bus._refusal("equipoise/alone/state", "0x1", error)
        assert text.startswith("cannot open equipoise/alone/state: ") and remedy in text, text


def a_service_in_creation_is_awaited(root, publisher):
    """As long as its file is incomplete, a service is in creation; after 3 s the file is damaged."""
    def content_of(path):
        with open(path, "rb") as file:
            return file.read()

    def write(content):
        os.chmod(path, 0o600)
        with open(path, "wb") as file:
            file.write(content)
        os.chmod(path, 0o400)

    (path,) = (path for path in glob.glob(f"{root}/services/*.service") if b"equipoise/alone/state" in content_of(path))
    bus, whole = _bus.Bus(STATION, "creation", root), content_of(path)
    for content in (whole[: len(whole) // 2], b""):
        write(content)
        completes = threading.Timer(1.0, write, [whole])
        completes.start()
        bus.subscriber(State, _messages.STATE, 1).delete()
        completes.join()
    write(b"")
    began_s = time.monotonic()
    refused(f"equipoise/alone/state: its files are damaged; stop all processes of this station and remove the directory {root}",
            lambda: bus.subscriber(State, _messages.STATE, 1))
    assert 2.9 < time.monotonic() - began_s < HANGS_AFTER_S, time.monotonic() - began_s
    write(whole)
    bus.close()


def hold(root, count):
    """Joins so often, and stays until standard input ends."""
    consumers = [joined(root, f"hold-{at}", report=False) for at in range(count)]
    for consumer in consumers:
        consumer.next(0.0)
    print("joined", flush=True)
    sys.stdin.read()


def clear(root):
    """Housekeeping: clears the dead away, a while after it is ready."""
    bus = _bus.Bus(STATION, "housekeeping", root)
    print("ready", flush=True)
    time.sleep(0.5)
    while True:
        bus._node.try_cleanup_dead_nodes()
        time.sleep(0.1)


def all_of(root):
    what_is_unavailable_is_no_number()
    errors_of_opening_have_a_remedy()
    plans_are_requested(root)
    publisher = Publisher(root)
    for test in (a_polling_consumer_reports, a_seldom_polling_consumer_reads, a_lost_bus_is_reported_until_it_is_read_again,
                 a_clock_ahead_blocks_no_consumer, a_stale_state_is_reported, states_keep_a_consumer_of_early_states_joined,
                 closed_consumers_stay_closed, leftovers_hang_no_consumer, a_service_in_creation_is_awaited,
                 slots_of_dead_processes_are_awaited):
        test(root, publisher)
    a_polling_consumer_rejoins(root, publisher).close()
    print("clients: the Python package on a bus of its own: silence, clocks, seldom, slow, closed and killed consumers; plans")


def main():
    what, *rest = sys.argv[1:]
    if what == "hold":
        return hold(rest[0], int(rest[1]))
    if what == "clear":
        return clear(rest[0])
    try:
        all_of(what)
    finally:
        for left in glob.glob(f"/dev/shm/{_bus.shared_memory_prefix(what)}*"):
            os.remove(left)
        shutil.rmtree(what, ignore_errors=True)


if __name__ == "__main__":
    try:
        main()
    except AssertionError as error:
        sys.exit(f"clients: {error}")
