"""The station's bus: the same root, prefix, names and settings as `bus/src` has."""

from __future__ import annotations

import contextlib
import ctypes
import importlib
import os
import re
import time
from typing import Any, Callable, Iterable, Optional, Type

from . import _messages as table

try:
    iox2: Any = importlib.import_module("iceoryx2")
except ImportError:  # On another machine there is no bus, and `equipoise.udp` needs none.
    iox2 = None

# Another process may be creating or removing a service: it is damaged or in flux if it still is after this time, s. As in
# bus/src/open.rs.
SETTLING_MAX_S = 3.0
# Pause before another attempt, s.
PAUSE_S = 0.005
# Parts of iceoryx2's names of errors.
OTHER_SCHEMA = ("IncompatibleTypes", "IncompatibleRequestOrResponse", "IncompatibleAttributes")
DAMAGED = ("ServiceInCorruptedState", "HangsInCreation")
IN_FLUX = ("InFlux", "MarkedForDestruction", "DoesNotExist", "AlreadyExists", "BeingCreated", "Interrupt")
FAILED = ("InternalFailure", "UnableToCreateServiceTag", "ServiceConfigCouldNotBeCreated", "UnableToGenerateUniqueServiceId")
# How often to look whether a place has become free.
PLACE_PAUSE_S = 0.05


class BusError(Exception):
    """What went wrong, where, and what to do about it."""


def root_of_environment() -> str:
    """`$EQUIPOISE_BUS_ROOT`, else `iceoryx2` in systemd's `$RUNTIME_DIRECTORY`, else iceoryx2's default."""
    explicit = os.environ.get(table.ROOT_VARIABLE)
    if explicit:
        return explicit
    runtime = os.environ.get("RUNTIME_DIRECTORY", "").split(":")[0]
    return os.path.join(runtime, "iceoryx2") if runtime else table.DEFAULT_ROOT


def shared_memory_prefix(root: str) -> str:
    """How the names of the bus's shared memory begin: FNV-1a of the root."""
    text = root.rstrip("/")
    if text == table.DEFAULT_ROOT:
        return "iox2_"
    value = 0x811C9DC5
    for byte in text.encode():
        value = ((value ^ byte) * 0x01000193) & 0xFFFFFFFF
    return f"eqp_{value:08x}_"


def _config(root: str) -> Any:
    text = root.rstrip("/")
    if not os.path.isabs(root) or len(text.encode()) > table.ROOT_BYTES_MAX:
        raise BusError(
            f"cannot keep the bus under {root}: set {table.ROOT_VARIABLE} to an absolute path of at most "
            f"{table.ROOT_BYTES_MAX} plain characters"
        )
    config = iox2.config.default()
    config.global_cfg.root_path = iox2.Path.new(text + "/")
    config.global_cfg.prefix = iox2.FileName.new(shared_memory_prefix(root))
    # A process killed during the removal of a dead process's resources leaves some that no process can remove, and iceoryx2
    # waits for ever for shared memory without a size: only the daemon removes resources, and checks for such memory first.
    config.global_cfg.node.cleanup_dead_nodes_on_creation = False
    config.global_cfg.node.cleanup_dead_nodes_on_destruction = False
    config.global_cfg.service.cleanup_dead_nodes_on_open = False
    return config


def _close_counters_to_others(root: str) -> None:
    """iceoryx2 lets everybody write to its counter of participants; on a root of our own it is for its owner alone."""
    prefix = shared_memory_prefix(root)
    if prefix == shared_memory_prefix(table.DEFAULT_ROOT):
        return  # Shared with every other user of iceoryx2 here.
    try:
        names = os.listdir("/dev/shm")
    except OSError:
        return
    for name in names:
        if name.startswith(prefix) and name.endswith(".global_mgmt"):
            with contextlib.suppress(OSError):  # Somebody else's file is that somebody's affair.
                os.chmod(os.path.join("/dev/shm", name), 0o600)


def _contains(text: str, words: Iterable[str]) -> bool:
    return any(word in text for word in words)


def _check_name(what: str, name: str) -> None:
    if not re.fullmatch(r"[A-Za-z0-9_-]{1,32}", name):
        raise BusError(f"{name!r} is no name for a {what}: use 1 to 32 letters, digits, '-' and '_'")


class Bus:
    """A place on a station's bus; makes ports. Belongs to the thread that joined.

    For `patience_s` it waits where all places are taken: the daemon's housekeeping clears those of the dead away.
    """

    def __init__(self, station: str, name: str, root: str, patience_s: float = 0.0) -> None:
        _check_name("station", station)
        _check_name("role", name)
        if iox2 is None:
            raise BusError("the bus needs the package iceoryx2==0.10.0: pip install it; equipoise.udp works without")
        config = _config(root)
        iox2.set_log_level(iox2.LogLevel.Error)
        builder = iox2.NodeBuilder.new().config(config).name(iox2.NodeName.new(f"equipoise/{station}/{name}"))
        builder = builder.signal_handling_mode(iox2.SignalHandlingMode.Disabled)
        self._station, self._root, self._patient_until = station, root, time.monotonic() + patience_s
        try:
            self._node: Optional[Any] = builder.create(iox2.ServiceType.Ipc)
        except Exception as cause:
            raise BusError(
                f"cannot join the bus under {root}: {cause}; the directory must be writable and belong to this user; "
                f"or set {table.ROOT_VARIABLE} to another one"
            ) from cause
        _close_counters_to_others(root)

    def close(self) -> None:
        """Leaves the bus; its ports must be closed before."""
        if self._node is not None:
            del self._node
            self._node = None

    def wait_no_more(self) -> None:
        """From now on, a missing slot is an error at once."""
        self._patient_until = 0.0

    def subscriber(self, message: Type[ctypes.Structure], row: table.Service, depth: int) -> Any:
        """A reader of a topic, with a buffer of `depth` messages."""
        if not 1 <= depth <= row.depth_max:
            name = self.full_name(row.suffix)
            raise BusError(f"cannot buffer {depth} messages of {name}: choose 1 to {row.depth_max}")
        factory = self._topic(message, row)
        make = lambda: factory.subscriber_builder().buffer_size(depth).history_request(row.history).create()
        return self._take(row.suffix, "subscriber", row.subscribers_max, make)

    def publisher(self, message: Type[ctypes.Structure], row: table.Service) -> Any:
        """A writer of a topic."""
        factory = self._topic(message, row)
        discard = iox2.BackpressureStrategy.DiscardData
        make = lambda: factory.publisher_builder().max_loaned_samples(1).backpressure_strategy(discard).create()
        return self._take(row.suffix, "publisher", row.publishers_max, make)

    def client(self, request: Type[ctypes.Structure], response: Type[ctypes.Structure], row: table.RequestService) -> Any:
        """A client of a request-response service."""
        factory = self._exchange(request, response, row)
        discard = iox2.BackpressureStrategy.DiscardData
        make = lambda: factory.client_builder().backpressure_strategy(discard).create()
        return self._take(row.suffix, "client", row.clients_max, make)

    def listener(self) -> Any:
        """Something that sleeps until results are published."""

        def attempt(name: Any, attributes: Any) -> Any:
            builder = self._node.service_builder(name).event()  # type: ignore[union-attr]
            builder = builder.event_id_max_value(table.EVENT_NUMBER_MAX)
            builder = builder.max_notifiers(table.NOTIFIERS_MAX).max_listeners(table.LISTENERS_MAX)
            builder = builder.max_nodes(table.NODES_MAX).disable_deadline()
            builder = builder.disable_notifier_created_event().disable_notifier_dropped_event()
            builder = builder.notifier_dead_event(iox2.EventId.new(table.NOTIFIER_DIED))
            return builder.open_or_create_with_attributes(attributes)

        factory = self._open(table.EVENTS, table.EVENTS_SCHEMA, attempt)
        make = lambda: factory.listener_builder().create()
        return self._take(table.EVENTS, "listener", table.LISTENERS_MAX, make)

    def _topic(self, message: Type[ctypes.Structure], row: table.Service) -> Any:
        def attempt(name: Any, attributes: Any) -> Any:
            builder = self._node.service_builder(name).publish_subscribe(message)  # type: ignore[union-attr]
            builder = builder.enable_safe_overflow(True).history_size(row.history)
            builder = builder.subscriber_max_buffer_size(row.depth_max)
            builder = builder.subscriber_max_borrowed_samples(table.BORROWED_MAX)
            builder = builder.max_publishers(row.publishers_max).max_subscribers(row.subscribers_max)
            return builder.max_nodes(table.NODES_MAX).open_or_create_with_attributes(attributes)

        return self._open(row.suffix, row.schema, attempt)

    def _exchange(
        self, request: Type[ctypes.Structure], response: Type[ctypes.Structure], row: table.RequestService
    ) -> Any:
        def attempt(name: Any, attributes: Any) -> Any:
            builder = self._node.service_builder(name).request_response(request, response)  # type: ignore[union-attr]
            builder = builder.enable_safe_overflow_for_requests(row.overflow_requests)
            builder = builder.enable_safe_overflow_for_responses(row.overflow_responses)
            builder = builder.enable_fire_and_forget_requests(row.fire_and_forget)
            builder = builder.max_active_requests_per_client(row.active_requests_max)
            builder = builder.max_loaned_requests(row.loaned_requests_max)
            builder = builder.max_response_buffer_size(row.responses_max)
            builder = builder.max_borrowed_responses_per_pending_response(row.borrowed_responses_max)
            builder = builder.max_servers(row.servers_max).max_clients(row.clients_max)
            return builder.max_nodes(table.NODES_MAX).open_or_create_with_attributes(attributes)

        return self._open(row.suffix, row.schema, attempt)

    def full_name(self, suffix: str) -> str:
        """Name of a service of this station."""
        return f"equipoise/{self._station}/{suffix}"

    def _open(self, suffix: str, schema: str, attempt: Callable[[Any, Any], Any]) -> Any:
        full_name = self.full_name(suffix)
        name = iox2.ServiceName.new(full_name)
        key, value = iox2.AttributeKey.new(table.SCHEMA_KEY), iox2.AttributeValue.new(schema)
        attributes = iox2.AttributeVerifier.new().require(key, value)
        until_s = time.monotonic() + SETTLING_MAX_S
        while True:
            try:
                return attempt(name, attributes)
            except Exception as cause:
                text = f"{cause}"
                if "ExceedsMaxNumberOfNodes" in text:
                    self._wait_for_place(suffix, "participant", table.NODES_MAX, cause)
                    continue
                if _contains(text, DAMAGED + IN_FLUX) and time.monotonic() < until_s:
                    time.sleep(PAUSE_S)
                    continue
                raise BusError(self._refusal(full_name, schema, text)) from cause

    def _refusal(self, full_name: str, schema: str, text: str) -> str:
        """The error of a service that does not open; as in bus/src/error.rs."""
        if _contains(text, OTHER_SCHEMA):
            return (
                f"cannot open {full_name}: it was made by another version of Equipoise (schema here {schema}); "
                "run the same release in all processes of this station"
            )
        if _contains(text, DAMAGED):
            return (
                f"cannot open {full_name}: its files are damaged; stop all processes of this station and remove the "
                f"directory {self._root}"
            )
        if _contains(text, IN_FLUX + FAILED):
            return f"cannot open {full_name}: {text}; if it persists, restart the processes of this station"
        if "InsufficientPermissions" in text:
            return f"cannot open {full_name}: it belongs to another user; run all processes of this station as one user"
        return (
            f"cannot open {full_name}: it was made with other settings ({text}); stop all processes of this station and "
            "start the same release everywhere"
        )

    def _take(self, suffix: str, what: str, most: int, make: Callable[[], Any]) -> Any:
        while True:
            try:
                return make()
            except Exception as cause:
                if "ExceedsMaxSupported" not in f"{cause}":
                    raise BusError(f"cannot make a port on {self.full_name(suffix)}: {cause}") from cause
                self._wait_for_place(suffix, what, most, cause)

    def _wait_for_place(self, suffix: str, what: str, most: int, cause: Exception) -> None:
        """A place may still belong to a dead process: then the daemon clears it away soon. Not from here, see `_config`."""
        if time.monotonic() >= self._patient_until:
            raise BusError(
                f"cannot join {self.full_name(suffix)}: all its {most} places for a {what} are taken; stop "
                "one that is not needed"
            ) from cause
        time.sleep(PLACE_PAUSE_S)
