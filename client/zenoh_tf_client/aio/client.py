"""`AsyncTransformClient`: the methods of the embedded tree, on a connection to a server."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from typing import Any, Self, TypeVar

from zenoh_tf import Dropped
from zenoh_tf._net.credentials import Credentials
from zenoh_tf._net.zenoh_config import address
from zenoh_tf.mirrors.interest import interest_of

from ..failover.connection import open_connection
from ..mirror.watching import Terms
from ..requests.receipt import Receipt
from ..session import environment
from ..session.connection import DEFAULT_TIMEOUT_S
from ..session.mapped_tree import Mode, check
from ..session.public import own_methods
from .batch import AsyncBatch
from .broadcaster import AsyncBroadcaster
from .gate import AsyncGate
from .introspection import AsyncIntrospection
from .lookups import AsyncLookups
from .mirror import AsyncMirror
from .session.connection import Connection
from .session.shared_reads import SharedReads
from .session.threads import in_thread
from .transaction import AsyncTransaction, repeat
from .watch import AsyncWatch
from .writes import AsyncWrites

T = TypeVar("T")


@own_methods
class AsyncTransformClient(AsyncLookups, AsyncWrites, AsyncIntrospection):
    """A connection to the server of one tree, for asyncio; made by `AsyncTransformClient.connect`.

    It has the methods of `TransformClient` as coroutines, with the same arguments, results and
    errors. Lookups, and sets of one authority, that are made in one turn of the event loop travel
    in one message. 4,000 calls and 2,000 waiting lookups may be under way; further callers wait
    for room. A cancelled call leaves nothing behind. If a write was sent before it was cancelled,
    the cause of the CancelledError is OutcomeUnknown. ``X_target_source`` maps coordinates in
    source to coordinates in target. Lengths are in metres, stamps in integer nanoseconds. After a
    lost connection the client reconnects by itself. An asynchronous context manager, which closes
    itself at the end.

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

    def __init__(self, connection: Connection) -> None:
        """Use `AsyncTransformClient.connect` instead.

        Args:
            connection: The open connection to use.

        Raises:
            TypeError: `connection` is something else, such as an endpoint.
        """
        if not isinstance(connection, Connection):
            raise TypeError(
                f"AsyncTransformClient needs an open connection, not {connection!r}; "
                "use await AsyncTransformClient.connect(endpoint, tree, timeout_s)"
            )
        self._connection = connection
        mapped = connection.mapped
        self._reads = SharedReads(connection, mapped)
        mapped.attach(self)
        self._broadcasters: set[AsyncBroadcaster] = set()  # those that are open

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
        """Connect to the server of a tree.

        What is left out comes from the environment, as for the commands: `ZENOH_TF_CONNECT`, else
        tcp/127.0.0.1:7447; `ZENOH_TF_TREE`, else main; `ZENOH_TF_USER` and the other variables of
        docs/how-to/security.md; `ZENOH_TF_READS`, else shared.

        Args:
            endpoint: Where the server, or a Zenoh router, listens: ``tcp/HOST:PORT``, with TLS
                ``tls/HOST:PORT``. Several, as a list or with commas between: the client connects to
                the first that answers, continues at the next one when that is gone, and returns
                when it is back; see "Several endpoints" in docs/explanation/outages.md.
            tree: The name of the tree.
            timeout_s: How long to try, in seconds; also how long each call waits for its reply.
            credentials: User, password and the files for TLS; see docs/how-to/security.md.
            reads: How lookups are answered. ``"shared"``: from the server's memory, which this
                process maps, where the server is on this host and shares its tree; else by queries.
                ``"query"``: by queries, as also with several endpoints. Both give the same answers
                and errors.

        Returns:
            An open client of the running event loop.

        Raises:
            ServerUnavailable: No server of the tree answered within `timeout_s`.
            AccessDenied: The server does not let this client in, or the client does not trust the
                server's certificate; the message says why.
            InvalidArgumentException: An argument is invalid.
            ProtocolError: The server's reply is malformed.

        Example:
            ``tf = await AsyncTransformClient.connect("tcp/robot:7447", tree="main")``
        """
        endpoint = environment.endpoint() if endpoint is None else endpoint
        tree = environment.tree() if tree is None else tree
        credentials = environment.client_credentials() if credentials is None else credentials
        reads = environment.reads() if reads is None else reads
        check(reads)
        if True:  # asynchronous
            return cls(await Connection.open(endpoint, tree, timeout_s, credentials, reads))
        else:
            return cls(open_connection(endpoint, tree, timeout_s, credentials), reads)

    def __repr__(self) -> str:
        opened = self._connection.opened
        return (
            f"<AsyncTransformClient {address(opened.endpoint)}, tree {opened.tree!r}, "
            f"server {opened.known_instance or 'unknown'}, "
            f"{'closed' if self._connection.closed else 'open'}>"
        )

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Close the connection and its broadcasters. May be called again.

        Calls of other tasks that wait for a reply fail at once. What was published may be lost if
        the server does not accept it within two seconds. A program that ends closes its clients by
        itself.
        """
        if True:  # asynchronous
            await self._connection.close(self._close_broadcasters)
        else:
            # The connection first: a thread inside `send` may hold its broadcaster for long.
            self._connection.close()
            self._reads.mapped.close()
            self._close_broadcasters()

    def _close_broadcasters(self) -> None:
        for broadcaster in list(self._broadcasters):
            broadcaster._end()

    @property
    def endpoint(self) -> str:
        """Returns the endpoint that the client is connected to, or was last."""
        return self._connection.opened.endpoint

    @property
    def tree_name(self) -> str:
        """Returns the name of the tree."""
        return self._connection.opened.tree

    @property
    def reads(self) -> Mode:
        """Returns how a lookup would be answered now.

        ``"shared"``: from the server's memory, without suspending the caller. ``"query"``: by a
        query of the server, as long as its memory cannot be read. This changes by itself, for
        example when the server restarts; `stats` has the reasons, under names with ``reads_``.
        """
        return self._reads.mapped.in_use

    def gate(
        self,
        target: str,
        *,
        queue_size: int = 100,
        timeout_s: float = 1.0,
        on_drop: Callable[[Dropped[Any]], object] | None = None,
        max_gap_s: float | None = None,
    ) -> AsyncGate:
        """As `TransformTree.gate`; `on_drop` is called on the event loop. Not a coroutine.

        Example:
            ``async with tf.gate("map") as gate: gate.put(image, "camera", stamp_ns)``
        """
        return AsyncGate(self, target, queue_size, timeout_s, on_drop, max_gap_s)

    @property
    def replica_age_s(self) -> float | None:
        """Returns how old the last answer of the service may be, in seconds.

        It counts if a replica gave it: see docs/how-to/replicas.md. None if the server itself
        answered.
        """
        return self._connection.opened.exchange.replica_age_s

    @property
    def last_receipt(self) -> Receipt | None:
        """Returns the `Receipt` of this client's last write that the server has replied to.

        None if there is none yet. See `Mirror.wait_for`.
        """
        return self._connection.opened.last_receipt

    @property
    async def instance(self) -> str:
        """Returns the id of the server that answered last; a restarted server has a new one.

        Asks the server if no id is known: ``await tf.instance``.

        Raises:
            ServiceException: No id is known, and no server answered.
        """
        opened = self._connection.opened
        if (known := opened.known_instance) is not None:
            return known
        return await self._connection.run(lambda: opened.instance)

    def batch(self) -> AsyncBatch:
        """Start a batch: many operations in one round trip. Not a coroutine, as it only records.

        Returns:
            An empty `AsyncBatch`, to be used in an ``async with`` block.

        Example:
            ``async with tf.batch() as batch: base = batch.lookup_transform("map", "base")``
        """
        return AsyncBatch(self._connection)

    def transaction(self) -> AsyncTransaction:
        """Start one attempt at a read-modify-write; `run_transaction` repeats attempts.

        Not a coroutine, as it does not ask the server.

        Returns:
            An empty `AsyncTransaction`, to be used in an ``async with`` block.

        Example:
            ``async with tf.transaction() as tx: tx.set_transform(stamped)``
        """
        return AsyncTransaction(self._connection, self._reads)

    async def run_transaction(
        self, function: Callable[[AsyncTransaction], Awaitable[T]], attempts: int = 10
    ) -> T:
        """Call `function` with a new transaction and commit it; repeat this after a conflict.

        An exception of `function` ends it only if what it has read is the state of one instant;
        else it counts as a conflict.

        Args:
            function: A coroutine function that reads and sets through the transaction. It may be
                called several times.
            attempts: How often to call it at most.

        Returns:
            What `function` returned in the attempt that was committed.

        Raises:
            TransactionConflict: Others changed what was read, in every attempt.
            TransformException: `function` or the commit failed; see `AsyncTransaction.commit`.

        Example:
            ``await tf.run_transaction(lift)``
        """
        return await repeat(lambda _: self.transaction(), function, attempts)

    async def mirror(
        self,
        pairs: Sequence[tuple[str, str]] | None = None,
        *,
        max_delay_s: float | None = None,
        max_rate_hz: float | None = None,
        timeout_s: float = 30.0,
    ) -> AsyncMirror:
        """Make a copy of the tree in this process, which follows the server's.

        Lookups in it are as fast as in an embedded tree. A copy of the whole tree costs memory as
        the server's does, and processor time for every change; one for some pairs of frames costs
        that for the frames on the paths between them.

        Args:
            pairs: (target, source) frames of the lookups that the mirror is for. It has the frames
                on the paths between them, which follow the current topology, and no others. The
                frames need not exist yet. None for all frames.
            max_delay_s: How long the server may gather changes of the pairs' frames before it sends
                them, in seconds, up to 10; None for 0.05. Each message costs more than what is in
                it, so that 0 costs about four times as much, beside frames at 100 Hz. A change
                after a pause is sent sooner.
            max_rate_hz: Thin the stream: at most at this rate, the server sends the newest sample
                of each frame that has changed. Lookups at a time interpolate between those. From
                0.001 to 1,000; None for all samples, at once.
            timeout_s: How long to wait for the first copy, in seconds.

        Returns:
            An `AsyncMirror`, to be used in an ``async with`` block. It is closed with the client,
            if not before.

        Raises:
            ServerBusy: Too many mirrors have pairs or rates of their own.
            TimeoutException: The copy was not complete in time.
            LimitExceeded: A frame's history is larger than a reply of the server may be, or there
                are too many pairs or frames.
            InvalidArgumentException: An argument is wrong; `field` names it.
            ServiceException: As for every call; see the class.

        Example:
            ``async with await tf.mirror() as m: print(await m.lookup_transform("map", "base"))``
        """
        interest = interest_of(pairs, max_delay_s, max_rate_hz)
        return await in_thread(
            lambda: AsyncMirror(self._connection, self._reads, timeout_s, interest),
            undo=lambda mirror: mirror._end(),
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
    ) -> AsyncWatch:
        """Follow the pose of a pair of frames, pushed by the server.

        Args:
            target: The frame to express the pose in.
            source: The frame whose pose is followed. Neither need exist yet.
            max_rate_hz: The highest rate of poses, each the newest of its time, from 0.001 to
                1,000. None for all changes; the server may gather them for 0.05 s.
            min_translation_m: Ignore a move by this distance or less from the last pose that was
                `"found"` or `"moved"`, in metres; infinite for a dead-band of angles alone.
            min_rotation_rad: The same for the angle of the rotation between the two, in radians.
                Either one being exceeded suffices.
            heartbeat_s: Return the pose after so many seconds without an event, from 0.01 to 3600.

        Returns:
            An `AsyncWatch`, for ``async with`` and ``async for``; closed with the client.

        Raises:
            ServerBusy: Too many mirrors and watches have pairs or rates of their own.
            TimeoutException: The first copy was not complete within 30 s.
            LimitExceeded: A name is too long, or there are too many frames between the two.
            InvalidArgumentException: An argument is invalid; `field` names it.
            ServiceException: As for every call; see the class.

        Example:
            ``async for event in await tf.watch("map", "base"): print(event.pose)``
        """
        terms = Terms(min_translation_m, min_rotation_rad, heartbeat_s)
        mirror = await self.mirror([(target, source)], max_rate_hz=max_rate_hz)
        return AsyncWatch(mirror, target, source, terms)

    async def broadcaster(self, authority: str) -> AsyncBroadcaster:
        """Make a publisher of transforms, which sends without waiting for a reply.

        Args:
            authority: The name to publish as, at most 255 bytes of UTF-8.

        Returns:
            An open `AsyncBroadcaster`. It is closed with the client, if not before.

        Raises:
            InvalidArgumentException: `authority` is too long or not valid UTF-8.
            ServerUnavailable: The client is closed.
            AccessDenied: The server's access rules do not allow to publish as `authority`.

        Example:
            ``wheels = await tf.broadcaster("wheels")``
        """
        return await self._connection.run(
            lambda: AsyncBroadcaster(self._connection, authority, self._broadcasters)
        )
