"""RTDE client (Universal Robots, protocol version 2) for the registers of clients/ur/handover.script.

clients/cpp/rtde.hpp is the same client in C++.
"""

from __future__ import annotations

import socket
import struct
import sys
import time
from typing import Dict, List, Optional, Tuple

from handover import Output, Position

CONNECT_EVERY_S = 1.0
# From connecting to the end of the handshake: less than the gap between two states that discards the target (STATE_GAP_MAX_S).
START_WITHIN_S = 0.6
# After this silence of the cobot its position is not used and nothing is sent: queued commands would arrive late.
COBOT_SILENT_S = 0.1
# After this time in which it sends or acknowledges nothing the connection is closed, as in gateways/src/rtde/link.rs.
LEAVE_AFTER_S = 0.3
READ_BYTES_MAX = 1 << 16
SAMPLES_MAX = 1 << 16

OUTPUT_NAMES = (
    "output_int_register_36,output_int_register_37,output_double_register_36,output_double_register_37,"
    "output_double_register_38,safety_mode,runtime_state"
)
OUTPUTS = struct.Struct(">BiidddiI")
INPUT_NAMES = (
    "input_int_register_36,input_int_register_37,input_double_register_36,input_double_register_37,"
    "input_double_register_38,input_double_register_39,input_double_register_40"
)
INPUTS = struct.Struct(">Biiddddd")
OUTPUT_HZ = 250.0
NORMAL, PLAYING, OUTSIDE, NO_HEARTBEAT, PROTECTIVE = 1, 2, 3, 4, 5


class Cobot:
    """RTDE client, protocol version 2; reconnects by itself."""

    def __init__(self, address: Tuple[str, int]) -> None:
        self._address = address
        self._socket: Optional[socket.socket] = None
        self._received = b""
        self._try_at_s = self._end_s = 0.0
        self._recipe = 0
        self._at_s = -1.0
        self._position_m: Position = (0.0, 0.0, 0.0)
        self._is_ready = False
        self._sent_at_s: Dict[int, float] = {}
        self.sequence = 0
        self.activity = -1
        self.answer_s: List[float] = []
        """Times from sending a command to its sequence in the cobot's output, s."""

    def part_m(self) -> Optional[Position]:
        """Position of the TCP in the station's world; None while the cobot is not ready."""
        is_current = self._socket is not None and time.monotonic() - self._at_s < COBOT_SILENT_S
        return self._position_m if is_current and self._is_ready else None

    @property
    def is_able(self) -> bool:
        """Whether its target is within its workspace."""
        return self.activity != OUTSIDE

    @property
    def is_held(self) -> bool:
        """Whether the cobot does not follow the commands."""
        return self.activity in (OUTSIDE, NO_HEARTBEAT)

    def poll(self) -> None:
        """Connects if necessary, and takes what the cobot has sent."""
        try:
            if self._socket is None:
                if time.monotonic() < self._try_at_s:
                    return
                self._try_at_s = time.monotonic() + CONNECT_EVERY_S
                self._connect()
            self._read()
            if time.monotonic() - self._at_s > LEAVE_AFTER_S:
                raise OSError("it sends no more packages")
        except OSError as error:
            self._lose(error)

    def send(self, output: Output) -> None:
        """Writes the registers, unless the cobot is silent; never waits."""
        if self._socket is None or time.monotonic() - self._at_s > COBOT_SILENT_S:
            return
        self.sequence = self.sequence % 0x7FFFFFFF + 1
        turned_rad = output.slope_rad, output.heading_rad
        data = INPUTS.pack(self._recipe, output.command, self.sequence, *output.target_m, *turned_rad)
        try:
            # A short write would break the stream: the cobot reads no more, and must hold.
            if self._socket.send(package("U", data)) != len(data) + 3:
                raise OSError("it takes no more packages")
        except OSError as error:
            self._lose(error)
            return
        self._sent_at_s[self.sequence] = time.monotonic()
        if len(self._sent_at_s) > 1000:
            self._sent_at_s.clear()

    def _connect(self) -> None:
        self._end_s = time.monotonic() + START_WITHIN_S
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        # Commands that are undelivered when the connection closes must never arrive: reset it.
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self._limit_wait()
        self._socket.connect(self._address)
        self._received = b""
        if self._ask("V", struct.pack(">H", 2)) != b"\x01":
            raise OSError("it does not support version 2 of RTDE")
        if self._ask("O", struct.pack(">d", OUTPUT_HZ) + OUTPUT_NAMES.encode())[:1] in (b"", b"\x00"):
            raise OSError(f"it does not provide {OUTPUT_NAMES}")
        answer = self._ask("I", INPUT_NAMES.encode())
        if answer[:1] in (b"", b"\x00"):
            raise OSError(f"it does not accept {INPUT_NAMES}: {answer[1:].decode(errors='replace')}")
        self._recipe = answer[0]
        if self._ask("S", b"") != b"\x01":
            raise OSError("it does not start the exchange")
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, round(1e3 * LEAVE_AFTER_S))
        self._socket.setblocking(False)
        # Its first output follows.
        self._is_ready, self._at_s = False, time.monotonic()

    def _limit_wait(self) -> None:
        """Limits the next call of the socket to the deadline of the handshake."""
        assert self._socket is not None
        left_s = self._end_s - time.monotonic()
        if left_s <= 0.0:
            raise OSError(f"it did not answer within {START_WITHIN_S} s")
        self._socket.settimeout(left_s)

    def _ask(self, kind: str, payload: bytes) -> bytes:
        assert self._socket is not None
        self._limit_wait()
        self._socket.sendall(package(kind, payload))
        while True:
            self._limit_wait()
            found = self._next()
            while found is None:
                self._limit_wait()
                bytes_ = self._socket.recv(4096)
                if not bytes_:
                    raise OSError("it closed the connection")
                self._received += bytes_
                found = self._next()
            if found[0] == kind:
                return found[1]

    def _next(self) -> Optional[Tuple[str, bytes]]:
        """The next complete package."""
        if len(self._received) < 3:
            return None
        size = int.from_bytes(self._received[:2], "big")
        if size < 3:
            raise OSError("this is not RTDE")
        if len(self._received) < size:
            return None
        kind, payload = chr(self._received[2]), self._received[3:size]
        self._received = self._received[size:]
        return kind, payload

    def _read(self) -> None:
        assert self._socket is not None
        try:
            # Limited: a peer may send faster than this reads.
            for _ in range(READ_BYTES_MAX // 4096):
                bytes_ = self._socket.recv(4096)
                if not bytes_:
                    raise OSError("it closed the connection")
                self._received += bytes_
        except BlockingIOError:
            pass
        while (found := self._next()) is not None:
            if found[0] == "U" and len(found[1]) == OUTPUTS.size:
                _, self.activity, sequence, x, y, z, safety, runtime = OUTPUTS.unpack(found[1])
                self._at_s, self._position_m = time.monotonic(), (x, y, z)
                self._is_ready = safety == NORMAL and runtime == PLAYING and self.activity != PROTECTIVE
                sent_at_s = self._sent_at_s.pop(sequence, None)
                if sent_at_s is not None and len(self.answer_s) < SAMPLES_MAX:
                    self.answer_s.append(self._at_s - sent_at_s)

    def _lose(self, error: OSError) -> None:
        print(f"cobot {self._address[0]}:{self._address[1]}: {error}", file=sys.stderr)
        if self._socket is not None:
            self._socket.close()
        self._socket = None
        self._sent_at_s.clear()


def package(kind: str, payload: bytes) -> bytes:
    """A package with its header."""
    return struct.pack(">HB", len(payload) + 3, ord(kind)) + payload
