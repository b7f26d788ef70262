"""Many operations in one round trip, in order, errors in place.

    with tf.batch() as batch:
        camera = batch.lookup_transform("map", "camera")
        stored = batch.set_transform(stamped)
    camera.result(), stored.result()

The operations run one after another, each as its own transaction; other clients' may
come between. An operation that fails leaves the others as they are. Lookups with a
`timeout_s` wait all at once and hold up nothing but the answer, which comes when the last
of them is done; where the batch also writes they fail with InvalidArgumentException.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Any, Generic, Self, TypeVar

from numpy.typing import ArrayLike

from zenoh_tf import (
    AuthorityInfo,
    FrameInfo,
    LatestTransform,
    StampedTransform,
    TransformArray,
    Velocity,
    wire,
)
from zenoh_tf.errors import TransformException

from . import columns, requests
from .requests import Read, Request

T = TypeVar("T")
A = TypeVar("A")

#: Sends a batch's operations: (operations, whether any writes, longest wait) -> the reply.
Send = Callable[[list[tuple[str, wire.Message]], bool, float], wire.Message]


class Handle(Generic[T]):
    """The result of one operation, once the batch has been sent."""

    __slots__ = ("_error", "_sent", "_value")

    def __init__(self) -> None:
        self._sent = False
        self._value: T | None = None
        self._error: TransformException | None = None

    def result(self) -> T:
        """The operation's result. Raises its error; RuntimeError before the batch is sent."""
        error = self.exception()
        if error is not None:
            raise error
        return self._value  # type: ignore[return-value]  # None only where T allows it

    def exception(self) -> TransformException | None:
        """The operation's error, or None."""
        if not self._sent:
            raise RuntimeError("the batch has not been sent: its block has not ended")
        return self._error

    def _settle(self, parse: Callable[[A], T], answer: A) -> None:
        try:
            self._value = parse(answer)
        except TransformException as error:
            self._error = error
        self._sent = True


class Batch:
    """Records operations; the end of the block sends them. Not for several threads."""

    def __init__(self, send: Send) -> None:
        self._send = send
        self._recorded: list[tuple[Request[Any], Handle[Any]]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if kind is None:
            self.send()

    def send(self) -> None:
        """Send what was recorded. Raises ServerUnavailable, OutcomeUnknown or LimitExceeded
        for the whole; every handle then raises it too."""
        recorded, self._recorded = self._recorded, []
        if not recorded:
            return
        operations, settlers = _join(recorded)
        try:
            writes = any(request.writes for request, _ in recorded)
            wait_s = max(request.wait_s for request, _ in recorded)
            reply = self._send(operations, writes, wait_s)
            replies = wire.parse_batch_reply(reply, len(operations))
        except TransformException as error:
            for _, handle in recorded:
                handle._settle(_raise, error)
            raise
        for settle, reply in zip(settlers, replies, strict=True):
            settle(reply)

    def _record(self, request: Request[T]) -> Handle[T]:
        handle: Handle[T] = Handle()
        self._recorded.append((request, handle))
        return handle

    def lookup_transform(
        self, target: str, source: str, stamp_ns: int | None = None, timeout_s: float = 0.0
    ) -> Handle[StampedTransform]:
        return self._record(requests.lookup_transform(target, source, stamp_ns, timeout_s))

    def lookup_transform_full(
        self,
        target: str,
        target_stamp_ns: int | None,
        source: str,
        source_stamp_ns: int | None,
        fixed_frame: str,
        timeout_s: float = 0.0,
    ) -> Handle[StampedTransform]:
        return self._record(
            requests.lookup_transform_full(
                target, target_stamp_ns, source, source_stamp_ns, fixed_frame, timeout_s
            )
        )

    def can_transform(
        self, target: str, source: str, stamp_ns: int | None = None, timeout_s: float = 0.0
    ) -> Handle[bool]:
        return self._record(requests.can_transform(target, source, stamp_ns, timeout_s))

    def lookup_latest_transform(self, target: str, source: str) -> Handle[LatestTransform]:
        return self._record(requests.lookup_latest_transform(target, source))

    def lookup_latest_transform_xact(self, target: str, source: str) -> Handle[LatestTransform]:
        return self._record(requests.lookup_latest_transform_xact(target, source))

    def lookup_latest_transforms_xact(
        self, pairs: Sequence[tuple[str, str]]
    ) -> Handle[list[LatestTransform]]:
        return self._record(requests.lookup_latest_transforms_xact(pairs))

    def lookup_transforms(
        self,
        targets: str | Sequence[str],
        sources: str | Sequence[str],
        stamps_ns: ArrayLike | None,
    ) -> Handle[TransformArray]:
        return self._record(requests.lookup_transforms(targets, sources, stamps_ns))

    def sample(self, target: str, source: str, stamps_ns: ArrayLike) -> Handle[TransformArray]:
        return self._record(requests.sample(target, source, stamps_ns))

    def latest_common_time(self, a: str, b: str) -> Handle[int | None]:
        return self._record(requests.latest_common_time(a, b))

    def lookup_velocity(
        self,
        tracking_frame: str,
        observation_frame: str,
        stamp_ns: int | None = None,
        averaging_interval_s: float = 0.1,
        *,
        reference_frame: str | None = None,
        reference_point: ArrayLike = (0.0, 0.0, 0.0),
        reference_point_frame: str | None = None,
    ) -> Handle[Velocity]:
        return self._record(
            requests.lookup_velocity(
                tracking_frame,
                observation_frame,
                stamp_ns,
                averaging_interval_s,
                reference_frame=reference_frame,
                reference_point=reference_point,
                reference_point_frame=reference_point_frame,
            )
        )

    def set_transform(
        self, stamped: StampedTransform, authority: str = "", static: bool = False
    ) -> Handle[bool]:
        return self._record(requests.set_transform(stamped, authority, static))

    def set_transforms_xact(
        self, stampeds: Sequence[StampedTransform], authority: str = "", static: bool = False
    ) -> Handle[None]:
        return self._record(requests.set_transforms_xact(stampeds, authority, static))

    def frames(self) -> Handle[list[str]]:
        return self._record(requests.frames())

    def frame(self, name: str) -> Handle[FrameInfo]:
        return self._record(requests.frame(name))

    def authorities(self) -> Handle[list[AuthorityInfo]]:
        return self._record(requests.authorities())

    def parent(self, frame: str, stamp_ns: int | None = None) -> Handle[str | None]:
        return self._record(requests.parent(frame, stamp_ns))

    def chain(self, target: str, source: str, stamp_ns: int | None = None) -> Handle[list[str]]:
        return self._record(requests.chain(target, source, stamp_ns))

    def stats(self) -> Handle[dict[str, int]]:
        return self._record(requests.stats())


def _raise(error: TransformException) -> Any:
    raise error


_Settle = Callable[[wire.Message], None]


def _join(
    recorded: list[tuple[Request[Any], Handle[Any]]],
) -> tuple[list[tuple[str, wire.Message]], list[_Settle]]:
    """The operations to send, single reads beside each other joined into one if they wait
    equally long, and for each what to do with its reply."""
    operations: list[tuple[str, wire.Message]] = []
    settlers: list[_Settle] = []
    run: list[tuple[Read[Any], Handle[Any]]] = []

    def end_run() -> None:
        if run:
            lookup = columns.join([read.row for read, _ in run])
            lookup.timeout_ns = requests.timeout_ns(run[0][0].wait_s)
            operations.append(("lookup", wire.lookup_body(lookup)))
            settlers.append(_settler_of_reads(run.copy()))
            run.clear()

    for request, handle in recorded:
        if isinstance(request, Read):
            if run and run[0][0].wait_s != request.wait_s:
                end_run()
            run.append((request, handle))
        else:
            end_run()
            operations.append((request.kind, request.body()))
            settlers.append(_settler(request, handle))
    end_run()
    return operations, settlers


def _settler(request: Request[Any], handle: Handle[Any]) -> _Settle:
    return lambda reply: handle._settle(request.parse, reply)


def _settler_of_reads(run: list[tuple[Read[Any], Handle[Any]]]) -> _Settle:
    def settle(reply: wire.Message) -> None:
        try:
            answer = wire.parse_lookup_reply(reply, len(run))
        except TransformException as error:
            for _, handle in run:
                handle._settle(_raise, error)
            return
        for (read, handle), row in zip(run, answer.rows(), strict=True):
            handle._sent = True
            try:
                handle._value = read.result(row)
            except TransformException as error:
                handle._error = error

    return settle
