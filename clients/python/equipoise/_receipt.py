"""Latency of received states, published once a second; core/src/message/consumer_receipt.rs explains the buckets."""

from __future__ import annotations

import os
import time
from typing import Any, Optional

from . import _messages as table
from ._bus import Bus, BusError
from ._messages import ConsumerReceipt, State

PUBLISH_EVERY_NS = 1_000_000_000
# A refused report is tried again this often: somebody else may have gone.
TRY_AGAIN_AFTER_NS = 10_000_000_000
# A time's octave begins to be divided here: 16 sub-buckets are 4 bits.
SUB_BUCKET_BITS = table.SUB_BUCKETS.bit_length() - 1


def bucket(time_ns: int) -> int:
    """The bucket of a time."""
    if time_ns < table.SUB_BUCKETS:
        return time_ns
    octave = time_ns.bit_length() - 1
    sub_bucket = (time_ns >> (octave - SUB_BUCKET_BITS)) & (table.SUB_BUCKETS - 1)
    return min(table.SUB_BUCKETS * (octave - SUB_BUCKET_BITS + 1) + sub_bucket, table.BUCKETS - 1)


class Reporting:
    """Keeps the report of one consumer, and publishes it if asked to."""

    def __init__(self, name: str, wanted: bool) -> None:
        self.report = ConsumerReceipt()
        self.refusal: Optional[BusError] = None
        for at, byte in enumerate(name.encode()):
            self.report.consumer[at] = byte
        self.report.process_id = os.getpid()
        self.report.since_ns = time.monotonic_ns()
        self._wanted = wanted
        self._publisher: Optional[Any] = None
        self._due_ns = self.report.since_ns + PUBLISH_EVERY_NS
        # Looked up once: a consumer has a millisecond for everything.
        report = self.report
        self._histograms = (report.published_to_consumer, report.due_to_consumer, report.suit_to_consumer)

    def enter(self, now_ns: int, state: State, missed: int, suit_sample_time_ns: int) -> None:
        """Enters one state; `suit_sample_time_ns` is 0 unless it is the first with that suit sample."""
        report = self.report
        report.states += 1
        report.states_missed += missed
        for index, from_ns in enumerate((state.published_ns, state.time_ns, suit_sample_time_ns)):
            # A stamp of 0 was never taken, and a later one than now belongs to another clock.
            if 0 < from_ns <= now_ns:
                time_ns = now_ns - from_ns
                self._histograms[index][bucket(time_ns)] += 1
                if time_ns > report.max_ns[index]:
                    report.max_ns[index] = time_ns

    def open(self, bus: Bus) -> None:
        """Takes a place among those who report. That there is none left is no reason not to read."""
        if not self._wanted:
            return
        try:
            self._publisher, self.refusal = bus.publisher(ConsumerReceipt, table.CONSUMER_RECEIPT), None
        except BusError as error:
            self._publisher, self.refusal = None, error
            self._due_ns = time.monotonic_ns() + TRY_AGAIN_AFTER_NS

    def close(self) -> None:
        """Gives the place up, before the bus that it is on."""
        if self._publisher is not None:
            self._publisher.delete()
            self._publisher = None

    def keep_up(self, bus: Bus, now_ns: int) -> None:
        """Publishes if a second has passed; tries to get a place again if it was refused one."""
        if not self._wanted or now_ns < self._due_ns:
            return
        if self._publisher is None:
            self.open(bus)
        self.publish()

    def publish(self) -> None:
        """Publishes now, if there is a place."""
        if self._publisher is None:
            return
        self.report.time_ns = time.monotonic_ns()
        self._due_ns = self.report.time_ns + PUBLISH_EVERY_NS
        try:
            self._publisher.send_copy(self.report)
        except Exception as cause:
            self.refusal = BusError(f"cannot send the report: {cause}")
            self.close()
            self._due_ns += TRY_AGAIN_AFTER_NS
