"""Evaluates what HdrHistogram's log processor read, and a trace: hlog.py FOLDER SECONDS."""

import collections
import json
import pathlib
import re
import sys

# What the logs are kept to: three digits.
RESOLUTION = 1e-3
PERCENTILES = ("p50_ns", "p90_ns", "p99_ns", "p99_9_ns", "p99_99_ns", "max_ns")
STAGES = {f"{side}.{stage}" for side in ("suit", "ground")
          for stage in ("transport", "adapter", "ingress", "wait", "to_state")}
STAGES |= {"loop.wake", "loop.intake", "loop.compute", "egress.wake", "egress.publish", "loop.to_state"}
OWN = {"self.receipt", "self.from_due", "self.from_suit"}


def read_by_java(log, tag):
    """Intervals, count and percentiles over all of them, as the processor's last line has them."""
    lines = [line for line in pathlib.Path(f"{log}.{tag}").read_text().splitlines() if " I:" in line]
    total = re.search(r"T:(\d+) \(([^)]*)\)", lines[-1])
    return len(lines), int(total[1]), dict(zip(PERCENTILES, map(float, total[2].split()), strict=True))


def tags(log):
    return set(pathlib.Path(f"{log}.tags").read_text().split())


def check_measured(folder):
    """`equipoise latency`: the file says what the JSON said."""
    log = folder / "path.hlog"
    report = json.loads((folder / "path.json").read_text())
    rows = report["stages"] + [row for consumer in report["consumers"] for row in consumer["stages"]]
    rows = {row["stage"]: row for row in rows if row["count"] > 0}
    assert set(rows) == tags(log), f"rows {sorted(set(rows) ^ tags(log))} are in one of file and JSON only"
    assert STAGES | OWN <= set(rows), f"no {sorted((STAGES | OWN) - set(rows))}"
    for tag, row in rows.items():
        _, count, read = read_by_java(log, tag)
        assert count == row["count"], f"{tag}: {count} values read, {row['count']} reported"
        for percentile, value in read.items():
            reported = row[percentile]
            is_near = abs(value - reported) <= RESOLUTION * reported + 1
            assert is_near, f"{tag}: {percentile} read as {value}, reported as {reported}"
    return len(rows)


def check_daemon(folder, seconds):
    """The daemon's own log: every cycle and every slot that was skipped is in it, over several intervals."""
    log = folder / "daemon.hlog"
    assert tags(log) == STAGES, f"tags {sorted(tags(log) ^ STAGES)}"
    said = (folder / "daemon.log").read_text()
    ended = re.search(r"cycles=(\d+) slots_skipped=(\d+) .*schedule_adds_up=true", said)
    assert ended, said
    intervals, count, read = read_by_java(log, "loop.wake")
    lost = sum(map(int, re.findall(r"fell behind: (\d+) cycles", said)))
    # Where cycles were lost to a full ring, skipped slots may be too.
    expected = int(ended[1]) - lost + int(ended[2])
    assert count == expected or 0 < lost and count <= expected, f"{count} values for {expected} cycles and slots"
    assert intervals > seconds // 10, f"{intervals} intervals"
    assert list(read.values()) == sorted(read.values()), read
    return count


def check_trace(folder):
    """Slices of a thread are nested, asynchronous ones have two ends, and no cycle between the first and last lacks."""
    trace = json.loads((folder / "trace.json").read_text())
    open_slices, waiting, cycles, kinds = collections.defaultdict(list), set(), [], collections.Counter()
    for event in trace["traceEvents"]:
        kinds[event["ph"]] += 1
        assert isinstance(event["pid"], int) and isinstance(event["tid"], int) and event["name"], event
        if event["ph"] == "X":
            begin, end = round(1e3 * event["ts"]), round(1e3 * (event["ts"] + event["dur"]))
            stack = open_slices[event["tid"]]
            while stack and stack[-1][1] <= begin:
                stack.pop()
            assert not stack or stack[-1][0] <= begin and end <= stack[-1][1], f"{event} crosses {stack[-1]}"
            stack.append((begin, end))
            if event["name"] == "cycle":
                cycles.append(event["args"]["cycle"])
        elif event["ph"] == "b":
            key = (event["cat"], event["id"], event["name"])
            assert key not in waiting, f"{event} begins twice"
            waiting.add(key)
        elif event["ph"] == "e":
            waiting.remove((event["cat"], event["id"], event["name"]))
        elif event["ph"] == "C":
            assert all(isinstance(value, (int, float)) for value in event["args"].values()), event
        else:
            assert event["ph"] in "Mi", event
    assert not waiting, f"{len(waiting)} never end"
    gaps = sum(event["args"]["cycles"] for event in trace["traceEvents"] if event["name"] == "not recorded")
    assert cycles == sorted(cycles) and len(cycles) + gaps == cycles[-1] - cycles[0] + 1, "cycles lack"
    return len(cycles), sum(kinds.values())


def main():
    folder, seconds = pathlib.Path(sys.argv[1]), float(sys.argv[2])
    rows = check_measured(folder)
    count = check_daemon(folder, seconds)
    cycles, events = check_trace(folder)
    print(f"hlog: {rows} rows as HdrHistogram's log processor reads them; {count} cycles and skipped slots in the "
          f"daemon's log; a trace of {cycles} cycles with {events} events")


if __name__ == "__main__":
    try:
        main()
    except AssertionError as error:
        sys.exit(f"hlog: {error}")
