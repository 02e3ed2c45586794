"""Evaluates what the consumers printed against what they reported: clients.py evaluate FOLDER NAME=PROCESS...

`refusals STATION` asks the Python package for what it must refuse, `arrays STATION` for its arrays and tables; `datagram
PORT STATION` reads the UDP gateway by the table of the documents; `mark NAME` is a small thing that bash cannot do.
"""

import pathlib
import socket
import sys
import time
import zlib

MS = 1_000_000
# A consumer's own limit of age, and the time until a line of its second is printed.
STALE_AFTER_NS, PRINTED_WITHIN_NS = 25 * MS, 1100 * MS
# A report and the station's own state are not looked at in the same moment, and this machine stands still at times.
CYCLES_APART = 250
RATE_HZ = 500


def pairs(line):
    return dict(word.split("=", 1) for word in line.split() if "=" in word)


def numbers(line):
    return {key: int(value) if value.lstrip("-").isdigit() else value for key, value in pairs(line).items()}


class Consumer:
    """What one printed, and what it reported."""

    def __init__(self, folder, name, process, reports):
        lines = (folder / f"{name}.out").read_text().splitlines()
        self.name, self.lines = name, [numbers(line) for line in lines if line.startswith("at_ns=")]
        ends = [numbers(line) for line in lines if line.startswith("end ")]
        assert len(ends) == 1, f"{name} did not say its last word"
        self.end = ends[0]
        self.reports = [report for report in reports if report["consumer"] == name]
        assert self.reports, f"{name} did not report"
        assert {report["pid"] for report in self.reports} == {process}, f"{name} is not one process"

    def current(self):
        return [line for line in self.lines if line["state"] == "current"]

    def check(self, holds, what):
        assert holds, f"{self.name}: {what}"


def check_sums(consumer, until_ns):
    """States and missed grow as the station's own cycles do, while one daemon runs."""
    of_one_daemon = [report for report in consumer.reports if report["at_ns"] < until_ns]
    consumer.check(len(of_one_daemon) >= 10, f"only {len(of_one_daemon)} reports")
    first, last = of_one_daemon[0], of_one_daemon[-1]
    counted = (last["states"] + last["missed"]) - (first["states"] + first["missed"])
    passed = last["cycle"] - first["cycle"]
    consumer.check(abs(counted - passed) <= CYCLES_APART, f"{counted} states received or missed, {passed} cycles passed")
    consumer.check(passed >= CYCLES_APART * 4, f"only {passed} cycles passed")
    for before, after in zip(consumer.reports, consumer.reports[1:]):
        consumer.check(before["states"] <= after["states"], "the count of states went back")
        consumer.check(before["since_ns"] == after["since_ns"], "the count was restarted")
        consumer.check(before["missed"] <= after["missed"], "the count of missed states went back")
    return counted, passed


def check_last_word(consumer):
    """The last report holds every state, and the p50 that the consumer found in its own list of times."""
    last, end = consumer.reports[-1], consumer.end
    for entries in ("published_entries", "due_entries"):
        consumer.check(last[entries] == last["states"], f"{last[entries]} {entries}, {last['states']} states")
    consumer.check(0 < last["suit_entries"] <= last["states"], f"{last['suit_entries']} suit samples")
    # States that were too old are in the report, and were not handed out.
    withheld = last["states"] - end["states"]
    consumer.check(0 <= withheld <= last["states"] // 10, f"{withheld} of {last['states']} states were too old")
    low, high = last["p50_from_ns"], last["p50_to_ns"]
    # Within a bucket: those withheld move the median of the report, if at all, to its neighbour.
    width = high - low
    consumer.check(
        low - width <= end["p50_ns"] < high + width, f"it printed p50 {end['p50_ns']} ns, it reports {low} to {high} ns"
    )
    return end["p50_ns"], low, high


def check_lines(consumer, marks):
    """Never an old state as new, never one while no daemon runs, and again some after it came back."""
    current = consumer.current()
    for before, after in zip(current, current[1:]):
        consumer.check(before["due_ns"] < after["due_ns"], "an old state as new")
    for line in current:
        age_ns = line["at_ns"] - line["due_ns"]
        consumer.check(age_ns <= STALE_AFTER_NS + PRINTED_WITHIN_NS, f"a state of {age_ns // MS} ms")
        dead = marks["daemon_killed"] + STALE_AFTER_NS < line["due_ns"] < marks["daemon_started"]
        consumer.check(not dead, "a state from a time without a daemon")
    # A line is due each second, so some are of the time without a daemon, and they must say so.
    silent = [
        line for line in consumer.lines
        if marks["daemon_killed"] + 2 * PRINTED_WITHIN_NS < line["at_ns"] < marks["daemon_started"]
    ]
    consumer.check(len(silent) >= 1, "no line from the time without a daemon")
    for line in silent:
        consumer.check(line["state"] == "silent", f"state={line['state']} without a daemon")
        consumer.check(line["speed_percent"] == 0, "the robot moves without a daemon")
    after = [line for line in current if line["at_ns"] > marks["daemon_ready"]]
    consumer.check(len(after) >= 2, "nothing after the daemon came back")
    consumer.check(after[-1]["due_ns"] > marks["daemon_started"], "it is still of the old daemon")
    consumer.check(after[-1]["cycle"] < current[0]["cycle"] + (after[-1]["at_ns"] - marks["daemon_started"]) * RATE_HZ // 10**9
                   + CYCLES_APART, "the cycle count was not restarted")
    consumer.check(consumer.end["restarts"] == 1, f"{consumer.end['restarts']} restarts noticed")


def check_unmoved(consumer, marks):
    """Another consumer was killed: this one continues to read at the same rate."""
    def reports(since, until):
        found = [report for report in consumer.reports if since < report["at_ns"] < until]
        consumer.check(len(found) >= 2, "too few reports")
        first, last = found[0], found[-1]
        states = last["states"] + last["missed"] - first["states"] - first["missed"]
        return states * 10**9 / (last["at_ns"] - first["at_ns"])

    before = reports(marks["began"], marks["victim_killed"])
    after = reports(marks["victim_killed"], marks["daemon_killed"])
    consumer.check(after > 0.5 * before, f"{before:.0f} states a second before, {after:.0f} after a neighbour's death")
    of_that_time = [line for line in consumer.lines if marks["victim_killed"] < line["at_ns"] < marks["daemon_killed"]]
    consumer.check(any(line["state"] == "current" for line in of_that_time), "no current state after a neighbour's death")
    consumer.check(all(line["restarts"] == 0 for line in of_that_time), "a restart after a neighbour's death")


def check_daemon(folder, reports, marks):
    """The daemon went on counting, and said nothing worse than that a participant died."""
    of_that_time = [report for report in reports if marks["victim_killed"] < report["at_ns"] < marks["daemon_killed"]]
    passed = of_that_time[-1]["cycle"] - of_that_time[0]["cycle"]
    assert passed > RATE_HZ, f"only {passed} cycles after a consumer's death"
    for line in (folder / "daemon.err").read_text().splitlines():
        assert "ERROR" not in line and "panicked" not in line, f"the daemon said: {line}"


def evaluate(folder, processes):
    marks = {name: int(at_ns) for name, at_ns in (line.split() for line in (folder / "marks").read_text().splitlines())}
    reports = [numbers(line) for line in (folder / "reader.out").read_text().splitlines()]
    for name, process in processes.items():
        consumer = Consumer(folder, name, process, reports)
        counted, passed = check_sums(consumer, marks["daemon_killed"])
        p50_ns, low, high = check_last_word(consumer)
        check_lines(consumer, marks)
        check_unmoved(consumer, marks)
        last = consumer.reports[-1]
        print(
            f"clients: {name}: {len(consumer.reports)} reports, {last['states']} states, {last['missed']} missed; "
            f"{counted} of {passed} cycles; p50 {p50_ns / 1000:.1f} µs, reported {low / 1000:.1f} to {high / 1000:.1f} µs"
        )
    for name in ("udp_c", "udp_python"):
        check_udp(folder, name, marks)
    check_daemon(folder, reports, marks)
    assert any(report["consumer"] == "victim" for report in reports), "the victim never reported"


def check_udp(folder, name, marks):
    """A reader of datagrams: receives all, and distinguishes the daemon's silence from the network's."""
    lines = [(line, pairs(line)) for line in (folder / f"{name}.out").read_text().splitlines() if line.startswith("state=")]
    states = [fields["state"] for _, fields in lines]
    assert states.count("current") >= 10, f"{name}: {states}"
    last_current = len(states) - 1 - states[::-1].index("current")
    assert "silent" in states[:last_current], f"{name} did not report that the daemon was dead: {states}"
    assert states[-1] == "network_silent", f"{name} did not notice that the gateway was gone: {states}"
    for line, fields in lines:
        moves = fields["state"] != "current" and fields["speed_percent"] != "0"
        assert not moves, f"{name}: the robot moves: {line}"
        assert fields["refused"] == "0", f"{name}: {line}"
    last = numbers(lines[-1][0])
    assert last["missed"] <= last["taken"] // 20, f"{name}: {last}"
    print(f"clients: {name}: {last['taken']} datagrams, {last['missed']} missed; "
          "the daemon's silence and the network's are distinguished")


def by_the_documents():
    """The layout as the page has it, for a reader that is not ours."""
    import construct

    kinds = {"u8": construct.Int8ul, "u16": construct.Int16ul, "u32": construct.Int32ul, "u64": construct.Int64ul,
             "f32": construct.Float32l}
    table = pathlib.Path("docs/consumers/udp.md").read_text().split("| offset |")[1].split("\n\n")[0]
    fields, end = [], 0
    for line in table.splitlines()[2:]:
        offset, declared, name = [cell.strip() for cell in line.split("|")[1:4]]
        kind, *shape = declared.replace("]", "").split("[")
        count = 1
        for size in shape:
            count *= int(size)
        assert int(offset) == end, f"{name} is at {offset}, the field before ends at {end}"
        field = construct.Bytes(count) if kind == "char" else kinds[kind][count] if shape else kinds[kind]
        fields.append(name.strip("`") / field)
        end += field.sizeof()
    return construct.Struct(*fields)


def datagram(port, station):
    layout, receiver = by_the_documents(), socket.socket(type=socket.SOCK_DGRAM)
    receiver.bind(("127.0.0.1", port))
    receiver.settimeout(10)
    before = 0
    for _ in range(100):
        data = receiver.recv(2048)
        assert len(data) == layout.sizeof(), f"{len(data)} bytes, by the documents {layout.sizeof()}"
        read = layout.parse(data)
        assert read.magic == b"EQPU" and read.version == 2 and read.length == len(data)
        assert read.crc32 == zlib.crc32(data[:-4]), "zlib finds another sum"
        assert read.station.rstrip(b"\0") == station.encode() and read.sequence > before
        before = read.sequence
        if read.status == 0:
            assert read.age_ns < 25 * MS and read.cycle > 0
            assert read.usable & 256 or not any(read.torque_nm), "a torque that may not be used is not 0"
    print(f"clients: construct reads datagrams by the documents' table, {len(data)} bytes, last {before}")


def arrays(station):
    """NumPy and pandas on real states."""
    import equipoise
    import numpy

    readings = []
    for reading in equipoise.subscribe(station, name="arrays"):
        readings.append(reading)
        if sum(map(bool, readings)) >= 50:
            break
    states = [reading for reading in readings if reading]
    with_origins = 0
    for reading in states:
        fatigue, level = reading.array("fatigue"), reading.array("joint_level")
        assert list(fatigue) == list(reading.state.fatigue) and fatigue.dtype == numpy.float64
        assert (level is None) == reading.invalidated_by(equipoise.INVALIDATES_TORQUES) == (reading.array("torque_nm") is None)
        origins = reading.array("segment_origin_m")
        if origins is not None:
            with_origins += 1
            assert origins.shape == (equipoise.SEGMENTS, 3) and list(origins.ravel()) == list(reading.state.segment_origin_m)
        cycle = reading.array("cycle")
        assert cycle.shape == (1,) and cycle[0] == reading.state.cycle
        reading.state.cycle += 1
        assert cycle[0] == reading.state.cycle, "an array is a copy"
        reading.state.cycle -= 1
        assert not cycle.flags.writeable
    assert with_origins, "the suit was never there"
    frame = equipoise.to_pandas(readings)
    assert list(frame["cycle"]) == [reading.state.cycle for reading in states]
    withheld = [reading.invalidated_by(equipoise.INVALIDATES_TORQUES) for reading in states]
    assert list(frame["torque_l5s1_nm"].isna()) == withheld
    one = equipoise.latest(station, name="once")
    assert one and one.state.cycle > states[-1].state.cycle
    print(f"clients: {len(states)} states as arrays and as a table of {len(frame.columns)} columns")


def refusals(station):
    """Calls that a consumer refuses and accepts. With the package installed, next to the other consumers."""
    import equipoise
    from equipoise import _bus, _messages, _receipt

    def refused(part, attempt):
        try:
            attempt()
        except equipoise.BusError as error:
            assert part in str(error), f"{part!r} is not in: {error}"
            return
        raise AssertionError(f"not refused: {part}")

    refused("is no name for a role", lambda: equipoise.subscribe(station, name="a b"))
    refused("absolute path", lambda: equipoise.subscribe(station, name="py", root="here"))
    refused("choose 1 to", lambda: equipoise.subscribe(station, name="py", depth=0))
    bus = _bus.Bus(station, "py", _bus.root_of_environment())
    other = _messages.STATE._replace(schema="0x0000000000000001")
    refused("another version of Equipoise", lambda: bus.subscriber(equipoise.State, other, 8))
    bus.close()

    # Law of the buckets: each begins where the one before ends, 16 in an octave.
    begins = [time_ns for time_ns in range(1, 5000) if _receipt.bucket(time_ns) != _receipt.bucket(time_ns - 1)]
    assert [_receipt.bucket(time_ns) for time_ns in begins] == list(range(1, len(begins) + 1)), "buckets follow each other"
    assert all(after - before <= max(1, before // 16) for before, after in zip(begins, begins[1:])), "16 in an octave"
    assert _receipt.bucket(2**64 - 1) == _messages.BUCKETS - 1

    places, crowd = _messages.CONSUMER_RECEIPT.publishers_max, []
    while not crowd or crowd[-1].report_refusal is None:
        crowd.append(equipoise.subscribe(station, name=f"crowd-{len(crowd)}"))
        assert len(crowd) <= places, f"more than {places} places for a report"
    last = crowd[-1]
    assert f"all its {places} places for a publisher are taken" in str(last.report_refusal), last.report_refusal
    readings = [last.next(1.0) for _ in range(20)]
    assert any(readings), "who has no place for its report does not read either"
    for consumer in crowd:
        consumer.close()
    print(f"clients: {len(crowd)} more joined; the last found no place for its report, and read")


def main():
    what, *rest = sys.argv[1:]
    if what == "refusals":
        refusals(rest[0])
    elif what == "arrays":
        arrays(rest[0])
    elif what == "datagram":
        datagram(int(rest[0]), rest[1])
    elif what == "mark":
        print(rest[0], time.monotonic_ns())
    else:
        processes = {name: int(number) for name, number in (pair.split("=") for pair in rest[1:])}
        evaluate(pathlib.Path(rest[0]), processes)


if __name__ == "__main__":
    try:
        main()
    except AssertionError as error:
        sys.exit(f"clients: {error}")
