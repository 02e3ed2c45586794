"""Takes the datagrams of a station's UDP gateway, on any machine: nothing but the standard library is needed.

    from equipoise import udp

    with udp.listen(7411, "station-1") as receiver:
        while True:
            datagram = receiver.next(0.05)
            if receiver.age_ns() > 50_000_000:
                print("stop:", receiver.status_name())          # no datagram, no state, or too old
            elif datagram is not None and datagram.usable & udp.Usable.TORQUES:
                print(datagram.torque_magnitude_nm)

docs/consumers/udp.md says what to check before a value is used.
"""

from __future__ import annotations

import enum
import select
import socket
import struct
import time
import zlib
from types import TracebackType
from typing import Any, Dict, Optional, Tuple, Type, Union

from ._udp_layout import BYTES, COUNTS, FORMAT, MAGIC, VERSION, Datagram, Status, Usable

__all__ = [
    "BYTES", "NEVER", "VERSION", "Datagram", "Reader", "Receiver", "Refused", "Status", "Usable", "decode", "listen"
]

# After so long without a datagram any session is taken, in case the sender's wall clock was put back.
FORGET_AFTER_NS = 1_000_000_000
# No datagram for this long: network or gateway failed, because the gateway reports a silent daemon at its rate.
NETWORK_SILENT_AFTER_NS = 100_000_000
# Two machines' clocks may run apart by one part in so many; two that NTP does not hold, by less.
DRIFT_PARTS = 5000
# Somebody who sends faster than this reads must not keep it for ever.
DRAINED_AT_ONCE = 4096
NEVER = 2**64 - 1

_LAYOUT = struct.Struct(FORMAT)
assert _LAYOUT.size == BYTES, "the format and the table differ"


class Refused(enum.Enum):
    """Reason why a datagram was rejected."""

    LENGTH = "length"
    MAGIC = "magic"
    VERSION = "version"
    CRC = "crc"
    STATION = "station"
    OLD = "old"


def decode(data: bytes) -> Union[Datagram, Refused]:
    """A datagram, if it is one of this version and whole."""
    if len(data) < 8:
        return Refused.LENGTH
    if data[:4] != MAGIC:
        return Refused.MAGIC
    version, length = struct.unpack_from("<HH", data, 4)
    if version != VERSION:
        return Refused.VERSION
    if len(data) != BYTES or length != BYTES:
        return Refused.LENGTH
    if zlib.crc32(data[:-4]) != struct.unpack_from("<I", data, BYTES - 4)[0]:
        return Refused.CRC
    flat: Tuple[Any, ...] = _LAYOUT.unpack(data)
    values: Dict[str, Any] = {}
    at = 0
    for name, count in COUNTS:
        values[name] = flat[at : at + count] if count > 1 else flat[at]
        at += count
    values["station"] = values["station"].rstrip(b"\0")
    return Datagram(**values)


class Reader:
    """Accepts the datagrams of one station, each once and in order; without a socket or a clock."""

    def __init__(self, station: Optional[str] = None) -> None:
        self._station = None if station is None else station.encode()
        self.last: Optional[Datagram] = None
        self.taken = self.missed = 0
        self.taken_at_ns = 0
        # Delay of the last datagram in addition to that of the fastest one of the session, including its time in the
        # socket, ns. `age_ns` adds it; add it to `sample_age_ns`, too.
        self.late_ns = 0
        self._drained_at_ns = self._bounded_at_ns = 0
        # Bounds of the difference of this clock from the station's, ns.
        self._ahead_ns: Optional[Tuple[int, int]] = None
        self.refused: Dict[Refused, int] = {why: 0 for why in Refused}

    def take(self, data: bytes, now_ns: int) -> Union[Datagram, Refused]:
        """Validates a datagram that arrived now, by a monotonic clock."""
        read = self._judge(data, now_ns)
        if isinstance(read, Refused):
            self.refused[read] += 1
            return read
        last = self.last
        if last is not None and last.session_ns == read.session_ns and read.sequence > last.sequence:
            self.missed += read.sequence - last.sequence - 1
        if last is None or last.session_ns != read.session_ns:
            self._ahead_ns = None
        if read.status == Status.CURRENT:
            self._measure(read, now_ns)
        self.last, self.taken, self.taken_at_ns = read, self.taken + 1, now_ns
        return read

    def drained(self, now_ns: int) -> None:
        """Reports that the socket was empty at that time: the next datagram arrived later.

        Before the first call the age of every state is that of the clock.
        """
        self._drained_at_ns = now_ns

    def age_ns(self, now_ns: int) -> int:
        """Present age of the newest state, ns: its age when it was sent, `late_ns`, and the time since its receipt.

        Without the travel time of the fastest datagram. NEVER if the last datagram had no state.
        """
        if self.last is None or self.last.status != Status.CURRENT:
            return NEVER
        return self.last.age_ns + self.late_ns + now_ns - self.taken_at_ns

    def status_name(self, now_ns: int) -> str:
        """Name of the present status: current, network_silent, or the reason why the station has no state."""
        if self.last is None or now_ns - self.taken_at_ns > NETWORK_SILENT_AFTER_NS:
            return "network_silent"
        names = {status.value: status.name.lower() for status in Status}
        return names.get(self.last.status, "unknown")

    def _measure(self, read: Datagram, now_ns: int) -> None:
        """Measures the lateness of a datagram.

        The offset of this clock from the station's is unknown, but bounded: a datagram cannot arrive before it was sent, and
        has waited in the socket at most since that was last empty. The lateness is relative to the lower bound.
        """
        apart_ns = now_ns - read.state_time_ns - read.age_ns
        least_ns = apart_ns - (now_ns - self._drained_at_ns)
        low_ns, high_ns = self._ahead_ns or (least_ns, apart_ns)
        if self._ahead_ns is not None:
            high_ns += (now_ns - self._bounded_at_ns) // DRIFT_PARTS
        high_ns = min(high_ns, apart_ns)
        # Where they cross, it was late on the network.
        low_ns = min(max(low_ns, least_ns), high_ns)
        self._ahead_ns, self._bounded_at_ns = (low_ns, high_ns), now_ns
        self.late_ns = apart_ns - low_ns

    def _judge(self, data: bytes, now_ns: int) -> Union[Datagram, Refused]:
        read, last = decode(data), self.last
        if isinstance(read, Refused):
            return read
        if self._station is not None and read.station != self._station:
            return Refused.STATION
        if last is None or now_ns - self.taken_at_ns >= FORGET_AFTER_NS:
            return read
        is_later = (read.session_ns, read.sequence) > (last.session_ns, last.sequence)
        return read if is_later else Refused.OLD


class Receiver:
    """A reader with a socket; `listen` makes one."""

    def __init__(self, port: int, station: Optional[str], address: str) -> None:
        self.reader = Reader(station)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((address, port))
        self._socket.setblocking(False)
        # The kernel's choice where it was asked for port 0.
        self.port: int = self._socket.getsockname()[1]

    def next(self, timeout_s: float) -> Optional[Datagram]:
        """Takes all that waits in the socket, and hands out the newest; None if nothing was taken in time."""
        end, before = time.monotonic() + timeout_s, self.reader.taken
        while True:
            for _ in range(DRAINED_AT_ONCE):
                if self._take() is None:
                    break
            if self.reader.taken > before:
                return self.reader.last
            if not self._wait(end - time.monotonic()):
                return None

    def next_or_refused(self, timeout_s: float) -> Union[Datagram, Refused, None]:
        """The next datagram that came, one after the other, or why it is refused: newer ones may wait behind it."""
        outcome = self._take()
        if outcome is None and self._wait(timeout_s):
            outcome = self._take()
        return outcome

    def _take(self) -> Union[Datagram, Refused, None]:
        """What waits in the socket, without waiting for it."""
        asked_ns = time.monotonic_ns()
        try:
            data = self._socket.recv(2048)
        except BlockingIOError:
            self.reader.drained(asked_ns)
            return None
        return self.reader.take(data, time.monotonic_ns())

    def _wait(self, timeout_s: float) -> bool:
        """Whether something came in time."""
        return timeout_s > 0 and bool(select.select([self._socket], [], [], timeout_s)[0])

    def age_ns(self) -> int:
        """As `Reader.age_ns`, now."""
        return self.reader.age_ns(time.monotonic_ns())

    def status_name(self) -> str:
        """As `Reader.status_name`, now."""
        return self.reader.status_name(time.monotonic_ns())

    def close(self) -> None:
        """Gives the port back."""
        self._socket.close()

    def __enter__(self) -> Receiver:
        return self

    def __exit__(
        self, kind: Optional[Type[BaseException]], error: Optional[BaseException], trace: Optional[TracebackType]
    ) -> None:
        self.close()


def listen(port: int, station: Optional[str] = None, address: str = "0.0.0.0") -> Receiver:
    """Receives one station's datagrams; without a name, those of any station."""
    return Receiver(port, station, address)
