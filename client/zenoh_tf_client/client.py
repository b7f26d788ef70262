"""`TransformClient`: the embedded tree's methods on a connection."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Self, TypeVar

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

from . import requests
from .batch import Batch
from .broadcaster import Broadcaster
from .connection import Connection
from .requests import Request
from .transaction import Transaction, run_transaction

T = TypeVar("T")

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
DEFAULT_TREE = "main"
DEFAULT_TIMEOUT_S = 5.0


class TransformClient:
    """A connection to the server of one tree; make it with `connect`.

    Methods, arguments, results and errors are those of `zenoh_tf.TransformTree`; on top of
    its errors every method raises ServerUnavailable when no server answers within the
    connection's time-out, and every write OutcomeUnknown when it may have been applied.
    After a lost connection the next calls find their way back by themselves.

    Thread safety: all methods.
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._broadcasters: list[Broadcaster] = []

    @classmethod
    def connect(
        cls,
        endpoint: str = DEFAULT_ENDPOINT,
        tree: str = DEFAULT_TREE,
        timeout_s: float = DEFAULT_TIMEOUT_S,
    ) -> Self:
        """Connect to the server of `tree`, trying for `timeout_s`, which is also how long
        each call waits for its answer. Raises ServerUnavailable."""
        return cls(Connection(endpoint, tree, timeout_s))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection and its broadcasters. May be called again."""
        broadcasters, self._broadcasters = self._broadcasters, []
        for broadcaster in broadcasters:
            broadcaster.close()
        self._connection.close()

    @property
    def endpoint(self) -> str:
        return self._connection.endpoint

    @property
    def tree(self) -> str:
        return self._connection.tree

    @property
    def instance(self) -> str:
        """The id of the server that answered last; a restarted server has another."""
        return self._connection.instance

    # --- reads

    def lookup_transform(
        self, target: str, source: str, stamp_ns: int | None = None, timeout_s: float = 0.0
    ) -> StampedTransform:
        return self._call(requests.lookup_transform(target, source, stamp_ns, timeout_s))

    def lookup_transform_full(
        self,
        target: str,
        target_stamp_ns: int | None,
        source: str,
        source_stamp_ns: int | None,
        fixed_frame: str,
        timeout_s: float = 0.0,
    ) -> StampedTransform:
        return self._call(
            requests.lookup_transform_full(
                target, target_stamp_ns, source, source_stamp_ns, fixed_frame, timeout_s
            )
        )

    def can_transform(
        self, target: str, source: str, stamp_ns: int | None = None, timeout_s: float = 0.0
    ) -> bool:
        return self._call(requests.can_transform(target, source, stamp_ns, timeout_s))

    def lookup_latest_transform(self, target: str, source: str) -> LatestTransform:
        return self._call(requests.lookup_latest_transform(target, source))

    def lookup_latest_transform_xact(self, target: str, source: str) -> LatestTransform:
        return self._call(requests.lookup_latest_transform_xact(target, source))

    def lookup_latest_transforms_xact(
        self, pairs: Sequence[tuple[str, str]]
    ) -> list[LatestTransform]:
        return self._call(requests.lookup_latest_transforms_xact(pairs))

    def lookup_transforms(
        self,
        targets: str | Sequence[str],
        sources: str | Sequence[str],
        stamps_ns: ArrayLike | None,
    ) -> TransformArray:
        return self._call(requests.lookup_transforms(targets, sources, stamps_ns))

    def sample(self, target: str, source: str, stamps_ns: ArrayLike) -> TransformArray:
        return self._call(requests.sample(target, source, stamps_ns))

    def latest_common_time(self, a: str, b: str) -> int | None:
        return self._call(requests.latest_common_time(a, b))

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
    ) -> Velocity:
        return self._call(
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

    # --- writes

    def set_transform(
        self, stamped: StampedTransform, authority: str = "", static: bool = False
    ) -> bool:
        return self._call(requests.set_transform(stamped, authority, static))

    def set_transforms_xact(
        self, stampeds: Sequence[StampedTransform], authority: str = "", static: bool = False
    ) -> None:
        self._call(requests.set_transforms_xact(stampeds, authority, static))

    def clear(self, keep_static: bool = True) -> None:
        self._call(requests.clear(keep_static))

    def reset(self) -> None:
        """Drop every frame at one instant: all samples, static links and names.

        The tree is then as new, apart from its counters and authorities. Broadcasters that
        keep static transforms do not announce them again until a server starts.

        Raises:
            ServerUnavailable: No server answered, and nothing was changed.
            OutcomeUnknown: The request was sent, but no answer came in time.

        Example:
            >>> tf.reset()
            >>> tf.frames()
            []
        """
        self._call(requests.reset())

    def remove_frame(self, name: str, subtree: bool = False) -> None:
        self._call(requests.remove_frame(name, subtree))

    # --- introspection

    def frames(self) -> list[str]:
        return self._call(requests.frames())

    def frame(self, name: str) -> FrameInfo:
        return self._call(requests.frame(name))

    def authorities(self) -> list[AuthorityInfo]:
        return self._call(requests.authorities())

    def parent(self, frame: str, stamp_ns: int | None = None) -> str | None:
        return self._call(requests.parent(frame, stamp_ns))

    def chain(self, target: str, source: str, stamp_ns: int | None = None) -> list[str]:
        return self._call(requests.chain(target, source, stamp_ns))

    def stats(self) -> dict[str, int]:
        return self._call(requests.stats())

    # --- beyond the embedded tree

    def batch(self) -> Batch:
        """Many operations in one round trip, errors in place; see `zenoh_tf_client.batch`."""
        return Batch(self._send_batch)

    def transaction(self) -> Transaction:
        """One attempt at a read-modify-write; see `zenoh_tf_client.transaction`."""
        return Transaction(self._connection)

    def run_transaction(self, function: Callable[[Transaction], T], attempts: int = 10) -> T:
        """Call `function` with a transaction and commit, up to `attempts` times while others
        change what it read. Returns what it returned in the attempt that was committed.
        Raises TransactionConflict after the last."""
        return run_transaction(self._connection, function, attempts)

    def broadcaster(self, authority: str) -> Broadcaster:
        """A publisher of transforms; closed with the client if not before."""
        broadcaster = Broadcaster(self._connection.session, self.tree, authority)
        self._broadcasters.append(broadcaster)
        return broadcaster

    def _call(self, request: Request[T]) -> T:
        if request.writes:
            return request.parse(self._connection.write(request.kind, request.body()))
        return request.parse(self._connection.read(request.kind, request.body(), request.wait_s))

    def _send_batch(
        self, operations: list[tuple[str, wire.Message]], writes: bool, wait_s: float
    ) -> wire.Message:
        body = wire.batch_body(operations)
        if writes:
            return self._connection.write("batch", body)
        return self._connection.read("batch", body, wait_s)
