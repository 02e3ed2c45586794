"""Taking part in a station as one who reads its states; clients/rust/src/consumer.rs does the same."""

from __future__ import annotations

import contextlib
import ctypes
import os
import time
from types import TracebackType
from typing import Any, Iterator, NamedTuple, Optional, Tuple, Type, Union

from . import _messages as table
from ._bus import Bus, BusError, iox2, root_of_environment
from ._messages import ConsumerReceipt, EarlyState, State
from ._receipt import Reporting
from .reading import EarlyReading, NoReading, NoStateReason, Reading

# After so long a silence all ports are reopened: the bus's directory may have been removed and recreated.
REJOIN_AFTER_NS = 2_000_000_000
# The longest that is slept at once: a report may be due meanwhile.
SLEEP_MAX_NS = 200_000_000
PAUSE_S = 0.02
# How long the first join waits for a slot; later a missing slot is an error at once, and the consumer rejoins.
PATIENCE_S = 2.5
UNKNOWN_AGE = 2**64 - 1
STATE_BYTES = ctypes.sizeof(State)
EARLY_BYTES = ctypes.sizeof(EarlyState)


class _Ports:
    def __init__(self, station: str, name: str, root: str, depth: int, patience_s: float = 0.0) -> None:
        self.bus = Bus(station, name, root, patience_s)
        self.events = self.bus.listener()
        self.states = self.bus.subscriber(State, table.STATE, depth)
        self.early: Optional[Any] = None  # Opened by the first call of `Consumer.early`.
        self.bus.wait_no_more()  # A slot for the report is not awaited.

    def close(self) -> None:
        """Ports first, then the bus that they hang on: else the place would look like one of a dead process."""
        self.states.delete()
        if self.early is not None:
            self.early.delete()
        self.events.delete()
        self.bus.close()


class _Last(NamedTuple):
    cycle: int
    time_ns: int
    writer: int


class Consumer:
    """Reads a station's states. Belongs to the thread that joined; `subscribe` makes one."""

    def __init__(
        self, station: str, name: str, root: str, depth: int, stale_after_ns: int, timeout_s: float, report: bool
    ) -> None:
        self._where = (station, name, root, depth)
        self._stale_after_ns, self._timeout_s = stale_after_ns, timeout_s
        self._ports: Optional[_Ports] = _Ports(*self._where, PATIENCE_S)
        self._reporting = Reporting(name, report)
        self._reporting.open(self._ports.bus)
        # When it was tried last to join; and when a state came last, handed out or not, or it was joined first.
        self._joined_ns = self._heard_ns = time.monotonic_ns()
        self._order: Optional[_Last] = None
        self._suit_sample_time_ns = 0
        self._last: Optional[Reading] = None
        self._last_early: Optional[EarlyReading] = None
        # Why the newest state was not returned, if so.
        self._refused: Optional[NoReading] = None
        # Why the bus was left; until it is read again.
        self._lost: Optional[NoReading] = None
        self._missed = self._withheld = 0
        self._restarted = False
        self._closed = False

    def next(self, timeout_s: float) -> Union[Reading, NoReading]:
        """The next state not yet handed out, oldest first; sleeps until one comes or the time has passed."""
        self._check_open()
        end_ns = time.monotonic_ns() + int(1e9 * timeout_s)
        passed_over: Optional[NoReading] = None
        try:
            while True:
                received = self._receive()
                while received is not None:
                    outcome = self._check_age(*received)
                    if isinstance(outcome, Reading):
                        # A consumer slower than the loop never waits below, but must report, too.
                        self._report()
                        return outcome
                    passed_over = passed_over if outcome is None else outcome  # A reason is false.
                    received = self._receive()
                # Before the time-out is checked: a consumer that polls without waiting rejoins, too.
                self._keep_up()
                left_ns = end_ns - time.monotonic_ns()
                if left_ns <= 0:
                    return self._why_none() if passed_over is None else passed_over
                self._sleep(min(left_ns, SLEEP_MAX_NS))
        except BusError as error:
            return self._lose_ports(error)

    def latest(self) -> Union[Reading, NoReading]:
        """The newest state there is, without sleeping. It may have been handed out before (`is_new`)."""
        self._check_open()
        try:
            newest, received = None, self._receive()
            # At most one buffer's worth, so that a fast publisher cannot keep us here.
            for _ in range(self._where[3]):
                if received is None:
                    break
                newest, received = received, self._receive()
            outcome = self._check_age(*(received or newest)) if newest else None
            # Only if nothing came: a consumer that polls rarely would lose its queued states, and receive none after a rejoin.
            if outcome is None:
                self._keep_up()
            else:
                self._report()
        except BusError as error:
            return self._lose_ports(error)
        if outcome is not None:
            return outcome
        if self._last is not None:
            again = self._aged(self._last._replace(is_new=False), time.monotonic_ns())
            if again.age_ns <= self._stale_after_ns:
                return again
        return self._why_none()

    def early(self) -> Union[EarlyReading, NoReading]:
        """The newest early state, without sleeping: the result about the newest suit sample, with a larger uncertainty.

        It may have been returned before (`is_new`). The first call subscribes.
        """
        self._check_open()
        try:
            newest = self._receive_early()
            if newest is None:
                # A rejoin would discard the queued states; if there are any, the bus is the current one.
                if self._must_rejoin() and self._receive() is not None:
                    self._heard_ns = time.monotonic_ns()
                self._keep_up()
        except BusError as error:
            return self._lose_ports(error)
        now_ns, last = time.monotonic_ns(), self._last_early
        if newest is not None:
            self._heard_ns = now_ns
            if newest.time_ns > now_ns:
                return self._ahead(newest.time_ns - now_ns)
            if last is None or newest.time_ns > last.early.time_ns:
                self._last_early = EarlyReading(newest, now_ns, 0, 0, False)
                return self._early_at(self._last_early._replace(is_new=True), now_ns)
        again = self._silent() if last is None else self._early_at(last, now_ns)
        return again if self._lost is None or isinstance(again, EarlyReading) else self._lost

    def _early_at(self, reading: EarlyReading, now_ns: int) -> Union[EarlyReading, NoReading]:
        age_ns, most_ns = now_ns - reading.early.time_ns, table.EARLY_STATE.deadline_ns
        if most_ns is not None and age_ns > most_ns:
            text = f"stale: the newest early state is {age_ns // 1_000_000} ms old, and may be {most_ns // 1_000_000} ms"
            return NoReading(NoStateReason.STALE, text)
        sample_age_ns = max(now_ns - reading.early.sample_time_ns, 0)
        return reading._replace(age_ns=age_ns, sample_age_ns=sample_age_ns)

    def _receive_early(self) -> Optional[EarlyState]:
        if self._ports is None:
            return None
        if self._ports.early is None:
            self._ports.early = self._ports.bus.subscriber(EarlyState, table.EARLY_STATE, table.EARLY_STATE.depth)
        try:
            newest: Optional[EarlyState] = None
            for _ in range(table.EARLY_STATE.depth):
                sample = self._ports.early.receive()
                if sample is None:
                    break
                newest = EarlyState()
                ctypes.memmove(ctypes.addressof(newest), sample.payload_ptr, EARLY_BYTES)
                sample.delete()
            self._lost = None
            return newest
        except Exception as cause:
            raise BusError(f"cannot receive early states: {cause}; the consumer rejoins") from cause

    def __iter__(self) -> Iterator[Union[Reading, NoReading]]:
        """One after the other, for ever, each as `next` gives it."""
        while True:
            yield self.next(self._timeout_s)

    @property
    def receipt_report(self) -> ConsumerReceipt:
        """How late states came so far."""
        return self._reporting.report

    @property
    def report_refusal(self) -> Optional[BusError]:
        """Why the report is not published, if it should be: all places may be taken. Reading does not suffer."""
        return self._reporting.refusal

    def close(self) -> None:
        """Leaves the station, with a last report so that the counts are complete. Later reads raise a `BusError`."""
        self._closed = True
        self._reporting.publish()
        self._leave()

    def __del__(self) -> None:
        """A caller that iterates over `subscribe()` itself cannot close it."""
        with contextlib.suppress(Exception):
            self._leave()

    def __enter__(self) -> Consumer:
        return self

    def __exit__(
        self, kind: Optional[Type[BaseException]], error: Optional[BaseException], trace: Optional[TracebackType]
    ) -> None:
        self.close()

    def _check_open(self) -> None:
        if self._closed:
            raise BusError("this consumer is closed: subscribe again")

    def _receive(self) -> Optional[Tuple[State, int]]:
        if self._ports is None:
            return None
        try:
            sample = self._ports.states.receive()
            self._lost = None
            if sample is None:
                return None
            state = State()
            ctypes.memmove(ctypes.addressof(state), sample.payload_ptr, STATE_BYTES)
            writer = sample.header.publisher_id.value
            sample.delete()
            return state, writer
        except Exception as cause:
            raise BusError(f"cannot receive states: {cause}; the consumer rejoins") from cause

    def _check_age(self, state: State, writer: int) -> Union[Reading, NoReading, None]:
        """Stamps and counts a state; None if it is no news."""
        now_ns = time.monotonic_ns()
        if state.time_ns > now_ns:
            # Before anything else is remembered of it: all later states would be old.
            self._heard_ns = now_ns
            self._refused = self._ahead(state.time_ns - now_ns)
            return self._refused
        cycle, time_ns, last = state.cycle, state.time_ns, self._order
        missed, restarted = 0, False
        if last is not None:
            if time_ns <= last.time_ns:
                return None
            restarted = writer != last.writer or cycle <= last.cycle
            missed = max(cycle - 1, 0) if restarted else cycle - last.cycle - 1
        self._order, self._heard_ns = _Last(cycle, time_ns, writer), now_ns
        self._reporting.enter(now_ns, state, missed, self._new_suit_sample(state))
        self._missed = missed if restarted else self._missed + self._withheld + missed
        self._restarted = self._restarted or restarted
        self._withheld = 0
        reading = self._aged(Reading(state, now_ns, 0, None, self._missed, self._restarted, True), now_ns)
        if reading.age_ns > self._stale_after_ns:
            self._withheld = 1
            self._refused = self._stale(reading)
            return self._refused
        self._refused = None
        self._last, self._missed, self._restarted = reading, 0, False
        return reading

    def _new_suit_sample(self, state: State) -> int:
        # An age of 0 is a sample from ahead of the cycle, whose own time a state does not tell.
        if state.suit_age_ns in (0, UNKNOWN_AGE) or state.time_ns - state.suit_age_ns <= self._suit_sample_time_ns:
            return 0
        self._suit_sample_time_ns = state.time_ns - state.suit_age_ns
        return self._suit_sample_time_ns

    @staticmethod
    def _ahead(ahead_ns: int) -> NoReading:
        text = f"the daemon's clock is {ahead_ns // 1_000_000} ms ahead of this one's; run both in one time namespace"
        return NoReading(NoStateReason.OTHER_CLOCK, text)

    def _stale(self, reading: Reading) -> NoReading:
        text = (
            f"stale: the newest state is {reading.age_ns // 1_000_000} ms old, and may be "
            f"{self._stale_after_ns // 1_000_000} ms; is this consumer or the daemon starved of CPU?"
        )
        return NoReading(NoStateReason.STALE, text)

    @staticmethod
    def _aged(reading: Reading, now_ns: int) -> Reading:
        sample_ns = reading.state.suit_sample_time_ns
        sample_age_ns = max(now_ns - sample_ns, 0) if sample_ns else None
        return reading._replace(age_ns=max(now_ns - reading.state.time_ns, 0), sample_age_ns=sample_age_ns)

    def _why_none(self) -> NoReading:
        """The bus error while the bus is lost. Otherwise silent, unless a state was refused recently: calls between two states
        then repeat its reason."""
        if self._lost is not None:
            return self._lost
        silent_ns = time.monotonic_ns() - self._heard_ns
        return self._silent() if self._refused is None or silent_ns > self._stale_after_ns else self._refused

    def _silent(self) -> NoReading:
        silent_ms = (time.monotonic_ns() - self._heard_ns) // 1_000_000
        return NoReading(NoStateReason.SILENT, f"silent: no state for {silent_ms} ms; is the daemon running?")

    def _keep_up(self) -> None:
        """Between two states: publishes the report if it is due, and rejoins after a long silence."""
        self._report()
        if self._must_rejoin():
            # The places held now must be free first: they may be the last.
            self._leave()
            self._joined_ns = time.monotonic_ns()
            self._ports = _Ports(*self._where)
            self._reporting.open(self._ports.bus)

    def _must_rejoin(self) -> bool:
        """Whether nothing was received for so long that the bus may have been recreated."""
        return time.monotonic_ns() - max(self._heard_ns, self._joined_ns) >= REJOIN_AFTER_NS

    def _report(self) -> None:
        """Publishes the report if it is due."""
        if self._ports is not None:
            self._reporting.keep_up(self._ports.bus, time.monotonic_ns())

    def _sleep(self, longest_ns: int) -> None:
        if self._ports is None:
            time.sleep(min(PAUSE_S, longest_ns / 1e9))
            return
        try:
            self._ports.events.timed_wait(iox2.Duration.from_nanos(longest_ns))
        except Exception as cause:
            if "Interrupt" in f"{cause}":
                return  # A signal: Python's own handlers run now.
            raise BusError(f"cannot wait for states: {cause}; the consumer rejoins") from cause

    def _leave(self) -> None:
        self._reporting.close()
        if self._ports is not None:
            self._ports.close()
            self._ports = None

    def _lose_ports(self, error: BusError) -> NoReading:
        """Closes broken ports; the consumer rejoins as after a silence."""
        self._leave()
        self._lost = NoReading(NoStateReason.BUS, f"{error}")
        return self._lost


def subscribe(
    station: Optional[str] = None,
    *,
    name: Optional[str] = None,
    root: Optional[str] = None,
    depth: int = table.STATE.depth,
    stale_after_s: float = (table.STATE.deadline_ns or 0) / 1e9,
    timeout_s: float = 0.025,
    report: bool = True,
) -> Consumer:
    """Joins a station as `name` (1 to 32 letters, digits, '-', '_'). The daemon need not run yet.

    Where all places are taken it waits 2.5 s: the daemon clears those of the dead away.
    Without a station it is that of EQUIPOISE_STATION, else `station-1`; without a name, `python-` and the process's number.
    A state is handed out only while it is younger than `stale_after_s`, counted from when its cycle was due. Iterating
    gives a `NoReading` after `timeout_s` without a state. `depth` states wait while the program is busy; 1 for who only
    wants the newest. With `report` it publishes how late states came, once a second.
    """
    station = station or os.environ.get("EQUIPOISE_STATION") or "station-1"
    name = name or f"python-{os.getpid()}"
    stale_after_ns = int(1e9 * stale_after_s)
    return Consumer(station, name, root or root_of_environment(), depth, stale_after_ns, timeout_s, report)


def latest(
    station: Optional[str] = None, *, name: Optional[str] = None, root: Optional[str] = None, timeout_s: float = 1.0
) -> Union[Reading, NoReading]:
    """Joins, takes one current state, and leaves. Who asks often keeps a `Consumer` and its `latest`."""
    with subscribe(station, name=name, root=root, depth=1, report=False) as consumer:
        return consumer.next(timeout_s)
