"""A cobot's controller on another machine, reduced to what it must check before it trusts a value.

    python clients/python/udp_controller.py 7411 station-1 60    # port, station, seconds; prints a line a second

With "each" as a fourth argument it prints a line for each datagram.
"""

from __future__ import annotations

import sys
import time

from equipoise import Level, Reason, udp

# How old a state may be while the robot acts on it.
STALE_AFTER_NS = 50_000_000
PRINT_EVERY_NS = 1_000_000_000


def speed_percent(receiver: udp.Receiver) -> int:
    """The robot's speed for what is known now, percent."""
    last = receiver.reader.last
    if last is None or receiver.age_ns() > STALE_AFTER_NS:
        return 0  # Nothing came, or it said that there is no state, or the state is too old.
    if last.valid == Reason.BELOW_LOAD_THRESHOLD:
        return 100  # Nothing is carried: that is knowledge, not the lack of it.
    if not last.usable & udp.Usable.TORQUES:
        return 25  # Torques are withheld: careful.
    # An undecided joint counts as its worst: its number is the highest.
    return {int(Level.GREEN): 100, int(Level.ORANGE): 60}.get(max(last.joint_level), 25)


def line(receiver: udp.Receiver) -> str:
    """The line of a second."""
    reader = receiver.reader
    cycle, daemon_life = (reader.last.cycle, reader.last.daemon_life) if reader.last else (0, 0)
    age_ms = -1 if receiver.age_ns() == udp.NEVER else receiver.age_ns() // 1_000_000
    return (
        f"state={receiver.status_name()} cycle={cycle} speed_percent={speed_percent(receiver)} taken={reader.taken} "
        f"missed={reader.missed} refused={sum(reader.refused.values())} daemon_life={daemon_life} age_ms={age_ms}"
    )


def each_line(one: udp.Datagram | udp.Refused) -> str:
    """The line of a datagram."""
    if isinstance(one, udp.Refused):
        return f"refused={one.value}"
    return (
        f"taken station={one.station.decode()} sequence={one.sequence} status={one.status} cycle={one.cycle} "
        f"age_ns={one.age_ns} valid={one.valid} usable={one.usable} worst_joint={one.worst_joint} "
        f"level_21={one.joint_level[21]} torque_21_z={one.torque_nm[65]:.3f} reach={one.reach_m:.3f} "
        f"dose={one.dose_probability:.3f}"
    )


def main() -> None:
    if len(sys.argv) < 4:
        sys.exit("usage: udp_controller.py PORT STATION SECONDS [each]")
    each = sys.argv[4:] == ["each"]
    end_ns = time.monotonic_ns() + int(1e9 * float(sys.argv[3]))
    print_ns = time.monotonic_ns() + PRINT_EVERY_NS
    with udp.listen(int(sys.argv[1]), sys.argv[2]) as receiver:
        print(f"listening on {receiver.port}", flush=True)
        while time.monotonic_ns() < end_ns:
            if each:
                outcome = receiver.next_or_refused(0.01)
                if outcome is not None:
                    print(each_line(outcome), flush=True)
            else:
                # The newest: whatever waits is taken, for the robot's own work may take longer than a datagram's period.
                receiver.next(0.01)
            # Command the robot's speed here, also when no datagram came.
            if not each and time.monotonic_ns() >= print_ns:
                print(line(receiver), flush=True)
                print_ns += PRINT_EVERY_NS
        print("end", line(receiver))


if __name__ == "__main__":
    main()
