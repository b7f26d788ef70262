"""`AsyncTransformClient`: the methods of the embedded tree, on a connection to a server."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

from zenoh_tf._net.credentials import Credentials

from ..client import TransformClient
from ..mirror.mirror import Mirror
from ..mirror.watch import Watch
from ..publish.broadcaster import Broadcaster
from ..requests.receipt import Receipt
from ..session import environment
from ..session.connection import DEFAULT_TIMEOUT_S
from ..session.mapped_tree import Mode, check
from ..session.public import own_methods
from .batch import AsyncBatch
from .introspection import AsyncIntrospection
from .session.connection import AsyncConnection
from .session.threads import in_thread
from .transaction import AsyncTransaction, repeat
from .writes import AsyncWrites

if TYPE_CHECKING:
    from typing_extensions import Self

    from zenoh_tf import Dropped
    from zenoh_tf.gates.gate import Gate

T = TypeVar("T")


@own_methods
class AsyncTransformClient(AsyncIntrospection, AsyncWrites):
    """A connection to the server of one tree, for asyncio; made by `AsyncTransformClient.connect`.

    It has the methods of `TransformClient` as coroutines, with the same arguments, results and
    errors. Lookups, and sets of one authority, that are made in one turn of the event loop travel
    in one message. 4,000 calls and 2,000 waiting lookups may be under way; further callers wait
    for room. A cancelled call leaves nothing behind. If a write was sent before it was cancelled,
    the cause of the CancelledError is OutcomeUnknown. ``X_target_source`` maps coordinates in
    source to coordinates in target. Lengths are in metres, stamps in integer nanoseconds. After a
    lost connection the client reconnects by itself. An asynchronous context manager, which closes
    itself at the end.

    Mirrors, gates, watches and broadcasters share no messages with calls, so they are those of
    `TransformClient`. What of them waits is called with `asyncio.to_thread`; gates and watches are
    asynchronous iterators.

    Every call raises the ServiceException ServerUnavailable if no server answers in time or the
    client is closed, ServerBusy or LimitExceeded if the server has too much to do, AccessDenied if
    its rules do not allow the call, and ProtocolError if a reply is malformed. With
    ServerUnavailable and ServerRestarted nothing was written; with OutcomeUnknown, which only
    writes raise, it may have been.

    Concurrency: all methods, from any task of the event loop that made the client. Any other loop
    gets RuntimeError, and needs a client of its own.

    Example:
        ``async with await AsyncTransformClient.connect() as tf: print(await tf.frames())``
    """

    def __init__(self, connection: AsyncConnection) -> None:
        """Use `AsyncTransformClient.connect` instead.

        Args:
            connection: The open connection to use.

        Raises:
            TypeError: `connection` is something else, such as an endpoint.
        """
        if not isinstance(connection, AsyncConnection):
            raise TypeError(
                f"AsyncTransformClient needs an open connection, not {connection!r}; "
                "use await AsyncTransformClient.connect(endpoint, tree, timeout_s)"
            )
        self._connection = connection
        self._mapped = connection.mapped
        self._mapped.attach(self)
        #: Makes what is not asynchronous.
        self._blocking = TransformClient(connection.opened, connection.mapped)

    @classmethod
    async def connect(
        cls,
        endpoint: str | Sequence[str] | None = None,
        tree: str | None = None,
        timeout_s: float = DEFAULT_TIMEOUT_S,
        *,
        credentials: Credentials | None = None,
        reads: Mode | None = None,
    ) -> Self:
        """As `TransformClient.connect`.

        Returns:
            An open client of the running event loop.

        Example:
            ``tf = await AsyncTransformClient.connect("tcp/robot:7447", tree="main")``
        """
        endpoint = environment.endpoint() if endpoint is None else endpoint
        tree = environment.tree() if tree is None else tree
        credentials = environment.client_credentials() if credentials is None else credentials
        reads = environment.reads() if reads is None else reads
        check(reads)
        return cls(await AsyncConnection.open(endpoint, tree, timeout_s, credentials, reads))

    def __repr__(self) -> str:
        return repr(self._blocking).replace("<", "<Async", 1)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def close(self) -> None:
        """As `TransformClient.close`. Calls of other tasks that wait for a reply fail at once."""
        await self._connection.close(self._blocking.close)

    @property
    def endpoint(self) -> str:
        """Returns the endpoint that the client is connected to, or was last."""
        return self._blocking.endpoint

    @property
    def tree_name(self) -> str:
        """Returns the name of the tree."""
        return self._blocking.tree_name

    @property
    def reads(self) -> Mode:
        """Returns how a lookup would be answered now, as `TransformClient.reads`."""
        return self._blocking.reads

    @property
    def age_s(self) -> float | None:
        """Returns the age of the last answer in seconds, as `TransformClient.age_s`."""
        return self._blocking.age_s

    @property
    def last_receipt(self) -> Receipt | None:
        """Returns the `Receipt` of this client's last write, as `TransformClient.last_receipt`."""
        return self._blocking.last_receipt

    @property
    async def instance(self) -> str:
        """Returns the id of the server that answered last, as `TransformClient.instance`.

        Example:
            ``await tf.instance``
        """
        if (known := self._connection.opened.known_instance) is not None:
            return known
        return await self._connection.run(lambda: self._blocking.instance)

    def batch(self) -> AsyncBatch:
        """As `TransformClient.batch`; not a coroutine, as it only records.

        Example:
            ``async with tf.batch() as batch: base = batch.lookup_transform("map", "base")``
        """
        return AsyncBatch(self._connection)

    def transaction(self) -> AsyncTransaction:
        """As `TransformClient.transaction`; not a coroutine, as it does not ask the server.

        Example:
            ``async with tf.transaction() as tx: tx.set_transform(stamped)``
        """
        return AsyncTransaction(self._connection, self._mapped)

    async def run_transaction(
        self, function: Callable[[AsyncTransaction], Awaitable[T]], attempts: int = 10
    ) -> T:
        """As `TransformClient.run_transaction`.

        Args:
            function: A coroutine function that reads and sets through the transaction. It may be
                called several times.
            attempts: How often to call it at most.

        Example:
            ``await tf.run_transaction(lift)``
        """
        return await repeat(lambda _: self.transaction(), function, attempts)

    def gate(
        self,
        target: str,
        *,
        queue_size: int = 100,
        timeout_s: float = 1.0,
        on_drop: Callable[[Dropped[Any]], object] | None = None,
        max_gap_s: float | None = None,
    ) -> Gate:
        """As `TransformTree.gate`; `on_drop` is called on threads. Not a coroutine.

        Example:
            ``async for image, transform in tf.gate("map"): show(image, transform.transform)``
        """
        from zenoh_tf.gates.gate import Gate  # noqa: PLC0415 - most programs need none

        return Gate(self._blocking, target, queue_size, timeout_s, on_drop, max_gap_s)

    async def mirror(
        self,
        pairs: Sequence[tuple[str, str]] | None = None,
        *,
        max_delay_s: float | None = None,
        max_rate_hz: float | None = None,
        timeout_s: float = 30.0,
    ) -> Mirror:
        """As `TransformClient.mirror`. A lookup without a time-out answers at once, on the loop.

        Example:
            ``with await tf.mirror() as m: print(m.lookup_transform("map", "base"))``
        """
        return await in_thread(
            lambda: self._blocking.mirror(
                pairs, max_delay_s=max_delay_s, max_rate_hz=max_rate_hz, timeout_s=timeout_s
            ),
            undo=Mirror.close,
        )

    async def watch(
        self,
        target: str,
        source: str,
        *,
        max_rate_hz: float | None = None,
        min_translation_m: float = 0.0,
        min_rotation_rad: float = 0.0,
        heartbeat_s: float = 1.0,
    ) -> Watch:
        """As `TransformClient.watch`.

        Example:
            ``async for event in await tf.watch("map", "base"): print(event.pose)``
        """
        return await in_thread(
            lambda: self._blocking.watch(
                target,
                source,
                max_rate_hz=max_rate_hz,
                min_translation_m=min_translation_m,
                min_rotation_rad=min_rotation_rad,
                heartbeat_s=heartbeat_s,
            ),
            undo=Watch.close,
        )

    async def broadcaster(self, authority: str) -> Broadcaster:
        """As `TransformClient.broadcaster`.

        Example:
            ``wheels = await tf.broadcaster("wheels")``
        """
        return await self._connection.run(lambda: self._blocking.broadcaster(authority))
