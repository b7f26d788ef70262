"""`TransformClient`: the methods of the embedded tree, on a connection to a server."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

from zenoh_tf._net.credentials import Credentials
from zenoh_tf._net.zenoh_config import address

from .batch import Batch
from .introspection import Introspection
from .publish.broadcaster import Broadcaster
from .requests.receipt import Receipt
from .session import environment
from .session.connection import DEFAULT_TIMEOUT_S, Connection
from .session.mapped_tree import MappedTree, Mode, check
from .session.public import own_methods
from .transaction import Transaction, repeat
from .writes import Writes

if TYPE_CHECKING:
    from typing_extensions import Self

    from zenoh_tf import Dropped
    from zenoh_tf.gates.gate import Gate

    from .mirror.mirror import Mirror
    from .mirror.watch import Watch

T = TypeVar("T")


@own_methods
class TransformClient(Introspection, Writes):
    """A connection to the server of one tree; made by `TransformClient.connect`.

    It has the methods of `zenoh_tf.TransformTree`, with the same arguments, results and errors,
    and adds the errors of the service. ``X_target_source`` maps coordinates in source to
    coordinates in target. Lengths are in metres, stamps in integer nanoseconds. After a lost
    connection the client reconnects by itself. A context manager, which closes itself at the end.
    A process that is forked after the first connection cannot connect, and every call raises
    ServerUnavailable: start such processes with multiprocessing's "spawn" method.

    Every call raises the ServiceException ServerUnavailable if no server answers in time or the
    client is closed, ServerBusy or LimitExceeded if the server has too much to do, AccessDenied if
    its rules do not allow the call, and ProtocolError if a reply is malformed. With
    ServerUnavailable and ServerRestarted nothing was written; with OutcomeUnknown, which only
    writes raise, it may have been.

    Thread safety: all methods.

    Example:
        ``with TransformClient.connect() as tf: print(tf.frames())``
    """

    def __init__(self, connection: Connection, mapped: MappedTree | None = None) -> None:
        """Use `TransformClient.connect` instead.

        Args:
            connection: The open connection to use.
            mapped: How lookups find the server's memory; None: where it can be mapped.

        Raises:
            TypeError: `connection` is something else, such as an endpoint.
        """
        if not isinstance(connection, Connection):
            raise TypeError(
                f"TransformClient needs an open connection, not {connection!r}; "
                "use TransformClient.connect(endpoint, tree, timeout_s)"
            )
        self._connection = connection
        self._mapped = MappedTree(connection) if mapped is None else mapped
        self._mapped.attach(self)
        self._broadcasters: set[Broadcaster] = set()  # those that are open

    @classmethod
    def connect(
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
                the first at which the tree's server answers, and to the next one when that is gone;
                see "Several endpoints" in docs/explanation/outages.md.
            tree: The name of the tree.
            timeout_s: How long to try, in seconds; also how long each call waits for its reply.
            credentials: User, password and the files for TLS; see docs/how-to/security.md.
            reads: How lookups are answered. ``"shared"``: from the server's memory, which this
                process maps, where the server is on this host and shares its tree; else by queries.
                ``"query"``: by queries, as also with several endpoints. Both give the same answers
                and errors.

        Returns:
            An open client.

        Raises:
            ServerUnavailable: No server of the tree answered within `timeout_s`.
            AccessDenied: The server does not let this client in, or the client does not trust the
                server's certificate; the message says why.
            InvalidArgumentException: An argument is invalid.
            ProtocolError: The server's reply is malformed.

        Example:
            ``tf = TransformClient.connect("tcp/robot:7447", tree="main")``
        """
        endpoint = environment.endpoint() if endpoint is None else endpoint
        tree = environment.tree() if tree is None else tree
        credentials = environment.client_credentials() if credentials is None else credentials
        reads = environment.reads() if reads is None else reads
        check(reads)
        opened = Connection(endpoint, tree, timeout_s, credentials)
        return cls(opened, MappedTree(opened, reads))

    def __repr__(self) -> str:
        opened = self._connection
        return (
            f"<TransformClient {address(opened.endpoint)}, tree {opened.tree!r}, "
            f"server {opened.known_instance or 'unknown'}, "
            f"{'closed' if self._connection.closed else 'open'}>"
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection and its broadcasters. May be called again.

        Calls of other threads that wait for a reply fail soon. What was published may be lost if
        the server does not accept it within two seconds. A program that ends closes its clients by
        itself.
        """
        # The connection first: a thread inside `send` may hold its broadcaster for long.
        self._connection.close()
        self._mapped.close()
        self._close_broadcasters()

    def _close_broadcasters(self) -> None:
        for broadcaster in list(self._broadcasters):
            broadcaster.close()

    @property
    def endpoint(self) -> str:
        """Returns the endpoint that the client is connected to, or was last."""
        return self._connection.endpoint

    @property
    def tree_name(self) -> str:
        """Returns the name of the tree."""
        return self._connection.tree

    @property
    def connection(self) -> Connection:
        """Returns the connection, for programs that publish or listen in the same Zenoh session."""
        return self._connection

    @property
    def reads(self) -> Mode:
        """Returns how a lookup would be answered now.

        ``"shared"``: from the server's memory, in well under a microsecond. ``"query"``: by a query
        of the server, as long as its memory cannot be read. This changes by itself, for example
        when the server restarts; `stats` has the reasons, under names with ``reads_``.
        """
        return self._mapped.in_use

    def gate(
        self,
        target: str,
        *,
        queue_size: int = 100,
        timeout_s: float = 1.0,
        on_drop: Callable[[Dropped[Any]], object] | None = None,
        max_gap_s: float | None = None,
    ) -> Gate:
        """As `TransformTree.gate`.

        Example:
            ``with tf.gate("map") as gate: gate.put(image, "camera", stamp_ns)``
        """
        from zenoh_tf.gates.gate import Gate  # noqa: PLC0415 - most programs need none

        return Gate(self, target, queue_size, timeout_s, on_drop, max_gap_s)

    @property
    def age_s(self) -> float | None:
        """Returns how old the last answer by query may be, in seconds; an upper bound.

        None if the server gave it that commits what is written, and so has the latest state.
        """
        return self._connection.age_s

    @property
    def last_receipt(self) -> Receipt | None:
        """Returns the `Receipt` of this client's last write that the server has replied to.

        None if there is none yet. See `Mirror.wait_for`.
        """
        return self._connection.last_receipt

    @property
    def instance(self) -> str:
        """Returns the id of the server that answered last; a restarted server has a new one.

        Asks the server if no id is known.

        Raises:
            ServiceException: No id is known, and no server answered.
        """
        opened = self._connection
        if (known := opened.known_instance) is not None:
            return known
        return opened.instance

    def batch(self) -> Batch:
        """Start a batch: many operations in one round trip.

        Returns:
            An empty `Batch`, to be used in a ``with`` block.

        Example:
            ``with tf.batch() as batch: base = batch.lookup_transform("map", "base")``
        """
        return Batch(self._connection)

    def transaction(self) -> Transaction:
        """Start one attempt at a read-modify-write; `run_transaction` repeats attempts.

        Returns:
            An empty `Transaction`, to be used in a ``with`` block.

        Example:
            ``with tf.transaction() as tx: tx.set_transform(stamped)``
        """
        return Transaction(self._connection, self._mapped)

    def run_transaction(self, function: Callable[[Transaction], T], attempts: int = 10) -> T:
        """Call `function` with a new transaction and commit it; repeat this after a conflict.

        An exception of `function` ends it only if what it has read is the state of one instant;
        else it counts as a conflict.

        Args:
            function: Reads and sets through the transaction. It may be
                called several times.
            attempts: How often to call it at most.

        Returns:
            What `function` returned in the attempt that was committed.

        Raises:
            TransactionConflict: Others changed what was read, in every attempt.
            TransformException: `function` or the commit failed; see `Transaction.commit`.

        Example:
            ``tf.run_transaction(lift)``
        """
        return repeat(lambda _: self.transaction(), function, attempts)

    def mirror(
        self,
        pairs: Sequence[tuple[str, str]] | None = None,
        *,
        max_delay_s: float | None = None,
        max_rate_hz: float | None = None,
        timeout_s: float = 30.0,
    ) -> Mirror:
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
            A `Mirror`, to be used in a ``with`` block. It is closed with the client,
            if not before.

        Raises:
            ServerBusy: Too many mirrors have pairs or rates of their own.
            TimeoutException: The copy was not complete in time.
            LimitExceeded: A frame's history is larger than a reply of the server may be, or there
                are too many pairs or frames.
            InvalidArgumentException: An argument is wrong; `field` names it.
            ServiceException: As for every call; see the class.

        Example:
            ``with tf.mirror() as m: print(m.lookup_transform("map", "base"))``
        """
        from zenoh_tf.mirrors.interest import interest_of  # noqa: PLC0415 - most programs need none

        from .mirror.mirror import Mirror  # noqa: PLC0415

        interest = interest_of(pairs, max_delay_s, max_rate_hz)
        return Mirror(self._connection, self._mapped, timeout_s, interest)

    def watch(
        self,
        target: str,
        source: str,
        *,
        max_rate_hz: float | None = None,
        min_translation_m: float = 0.0,
        min_rotation_rad: float = 0.0,
        heartbeat_s: float = 1.0,
    ) -> Watch:
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
            A `Watch`, for `with` and `for`; closed with the client.

        Raises:
            ServerBusy: Too many mirrors and watches have pairs or rates of their own.
            TimeoutException: The first copy was not complete within 30 s.
            LimitExceeded: A name is too long, or there are too many frames between the two.
            InvalidArgumentException: An argument is invalid; `field` names it.
            ServiceException: As for every call; see the class.

        Example:
            ``for event in tf.watch("map", "base"): print(event.pose)``
        """
        from .mirror.watch import Watch  # noqa: PLC0415 - most programs need none
        from .mirror.watching import Terms  # noqa: PLC0415

        terms = Terms(min_translation_m, min_rotation_rad, heartbeat_s)
        mirror = self.mirror([(target, source)], max_rate_hz=max_rate_hz)
        return Watch(mirror, target, source, terms)

    def broadcaster(self, authority: str) -> Broadcaster:
        """Make a publisher of transforms, which sends without waiting for a reply.

        Args:
            authority: The name to publish as, at most 255 bytes of UTF-8.

        Returns:
            An open `Broadcaster`. It is closed with the client, if not before.

        Raises:
            InvalidArgumentException: `authority` is too long or not valid UTF-8.
            ServerUnavailable: The client is closed.
            AccessDenied: The server's access rules do not allow to publish as `authority`.

        Example:
            ``wheels = tf.broadcaster("wheels")``
        """
        return Broadcaster(self._connection, authority, self._broadcasters)
