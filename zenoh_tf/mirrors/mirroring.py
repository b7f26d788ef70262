"""Keeps a copy of a server's tree up to date, without I/O: messages in, requests out.

The owner feeds in every stream message (`received`) and every reply (`answered`, `failed`), and
sends the requests that it is given, once it listens to the stream (docs/reference/protocol.md).

    plan ──> pieces ──> catching up ──> complete ──(gap)──> missed ──> complete
      ^___________________________________________________________|  forgotten, or a new server

`gaps.py` has the messages that wait because others are missing before them.

A copy is complete, and may be read, once it has all that the server had done when the last piece
was read. Until then, and while a new copy is made, the last complete one stays as it is.

Thread safety: none; the owner locks. Lookups in `tree` need no lock.
Invariant: between the owner's calls, `tree` is as the server's tree was after the commit with the
number `state.seq`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from .. import wire
from .._core import ChangeReplay
from .._net.server_clock import ServerClock
from ..errors import (
    ProtocolError,
    ServerBusy,
    ServerUnavailable,
    TimeoutException,
    TransformException,
)
from ..tree import TransformTree
from .copy import Copy, Observer
from .gaps import WaitingMessages
from .shared_bytes import SharedBytes
from .source import State

#: Requests for pieces that are under way at once.
_IN_FLIGHT: Final = 2
#: Errors after which the same request is sent again. After others, also ServerRestarted, the
#: mirror restarts with a snapshot.
_TRANSIENT: Final = (ServerBusy, ServerUnavailable, TimeoutException)
#: For the messages that wait for a snapshot or for missed ones; one mirror may use half of it.
_WAITING_BYTES: Final = 512 << 20
#: No server draws so many commit numbers between two messages.
_MAX_NUMBERS: Final = 1 << 24


@dataclass(frozen=True, slots=True)
class MirrorRequest:
    """A query to send: its type and body, and the number under which to give the reply back."""

    request_type: str  # "snapshot" or "missed"
    body: wire.Message
    number: int


#: Makes an empty tree with the settings of a server's, for the copy of an instance.
MakeTree = Callable[[wire.TreeSettings, str], TransformTree]


def make_tree(settings: wire.TreeSettings, instance: str, **options: Any) -> TransformTree:
    """An empty tree with the settings of a server's, and further options."""
    tree = TransformTree(
        settings.cache_ns / 1e9,
        max_frames=settings.max_frames,
        max_samples_per_frame=settings.max_samples_per_frame,
        max_name_bytes=settings.max_name_bytes,
        max_depth=settings.max_depth,
        **options,
    )
    if settings.startup_ns is not None:
        tree._begin_startup(*settings.startup_ns)
    for child, limits in settings.motion_limits.items():
        tree._set_motion_limits(child, *limits)
    return tree


class Mirroring:
    """A copy of a server's tree, and how it is made and kept."""

    def __init__(
        self,
        make_tree: MakeTree = make_tree,
        interest: wire.Interest | None = None,
        observer: Observer | None = None,
        *,
        keeps_tree: bool = True,
        room: SharedBytes | None = None,
        clock: ServerClock | None = None,
    ) -> None:
        """With `keeps_tree` False, trees stay empty: what comes goes to the observer alone.

        `room`: for messages that wait, which other mirrors share. `clock`: what the stream says of
        the server's real-time clock goes there.
        """
        self._clock = clock
        self._observer = observer
        self._keeps_tree = keeps_tree
        self._make_tree = make_tree
        self._interest = interest
        self._live: Copy | None = None  # the last complete copy
        self._next: Copy | None = None  # that replaces it
        self._waiting = WaitingMessages(room or SharedBytes(_WAITING_BYTES))
        self._requests: dict[
            int, wire.SnapshotRequest | None
        ] = {}  # under way; None: the plan, or missed ones
        self._number = 0
        self._wants_plan = True
        #: How many were begun.
        self.snapshots = 0
        #: How often a message could not be of the server, and the copy was given up.
        self.contradictions = 0

    # --- what the owner reads

    @property
    def tree(self) -> TransformTree | None:
        """The last complete copy; None until there is one. Another tree after a new snapshot."""
        return self._live.tree if self._live else None

    @property
    def state(self) -> State:
        """The last complete copy and what it is; `State()` until there is one."""
        live = self._live
        if live is None:
            return State()
        synced = not (self._next or self._wants_plan or self._waiting.messages)
        return State(live.tree, live.instance, live.seq, live.clock_ns, synced)

    @property
    def reach_seq(self) -> int:
        """The number of the last commit of which `tree` may have something."""
        return self._live.reach_seq if self._live else 0

    @property
    def followed(self) -> str:
        """The server instance whose messages are expected; empty if any is."""
        return self._copy.instance if self._copy else ""

    # --- what the owner feeds in

    def received(self, data: bytes, sender: str | None = None) -> None:
        """Take a message of `sender`'s stream. ProtocolError: nothing has changed."""
        message = wire.unpack_stream(data)
        if sender not in (None, message.instance):
            raise ProtocolError("the message names another server instance", field="instance")
        if message.last - message.first >= _MAX_NUMBERS:
            self.contradicted()
            return
        copy = self._copy
        if self._clock is not None and message.real_ns is not None:
            self._clock.real_is(message.instance, message.clock_ns, message.real_ns)
        if copy is not None and message.instance != copy.instance:
            self.restart()  # of a server that has gone, or that has come
        elif (
            copy is not None
            and copy is self._live
            and not self._waiting.messages
            and message.first <= copy.seq + 1
        ):
            if copy.repeats and message.first > max(copy.repeats):
                copy.repeats.clear()  # all of them have come, or were lost
            if copy.contradicts(message, data):
                self.contradicted()
            else:
                self._apply(copy, message)
            return
        # The message waits: for the copy, or for missed ones because there is a gap before it.
        if self._waiting.add(message, data):
            self._advance()
        else:
            self.restart()

    def take_requests(self) -> list[MirrorRequest]:
        """The requests to send now. Each is given once, until it is answered or has failed."""
        if self._wants_plan:
            # Until it is answered, nothing else is worth asking.
            body = wire.snapshot_request(None, self._interest)
            return [] if self._requests else [self._request("snapshot", None, body)]
        copy = self._copy
        found: list[MirrorRequest] = []
        if copy is None:
            return found
        while copy.pieces and len(self._requests) < _IN_FLIGHT:
            piece = copy.pieces.popleft()
            found.append(self._request("snapshot", piece, wire.snapshot_request(piece)))
        if self._waiting.has_gap and not self._requests:
            found.append(self._request("missed", None, self._waiting.request(copy, self._interest)))
        return found

    def awaits(self, number: int) -> bool:
        """Whether a request is still of use."""
        return number in self._requests

    def answered(self, number: int, reply: wire.Message) -> None:
        """Take the reply to a request. An error in it, or a malformed one, is a failure."""
        if number not in self._requests:
            return  # of a copy that was given up
        try:
            copy = self._copy
            if copy is not None and wire.text(reply, "instance") != copy.instance:
                self.restart()
            elif self._wants_plan:
                self._begin(wire.text(reply, "instance"), wire.parse_snapshot_plan(reply))
            elif (piece := self._requests[number]) is not None:
                loaded = wire.parse_snapshot_piece(reply)
                assert self._copy is not None
                self._copy.load(piece, loaded)
            else:
                self._take_missed(*wire.parse_missed_reply(reply))
        except TransformException as error:
            self.failed(number, error)
            return
        self._requests.pop(number, None)
        self._advance()

    def failed(self, number: int, error: Exception | None = None) -> None:
        """Record that a request has no reply; `take_requests` has it again, or restarts."""
        if number not in self._requests:
            return
        piece = self._requests.pop(number)
        if isinstance(error, TransformException) and not isinstance(error, _TRANSIENT):
            self.restart()
        elif piece is not None and self._copy is not None:
            self._copy.pieces.appendleft(piece)

    def contradicted(self) -> None:
        """Restart because the copy has, or was sent, what the server has not sent."""
        self.contradictions += 1
        self.restart()

    def connection_changed(self) -> None:
        """Another connection may bring what has come before."""
        if self._live is not None:
            self._live.overtaken_until = self._live.seq

    def restart(self) -> None:
        """Restart with a snapshot; the last complete copy stays until the new one is."""
        self._next = None
        self._wants_plan = True
        self._requests.clear()
        self._waiting.clear()

    # --- how a copy proceeds

    @property
    def _copy(self) -> Copy | None:
        """The copy that messages belong to."""
        return None if self._wants_plan else self._next or self._live

    def _request(
        self, request_type: str, piece: wire.SnapshotRequest | None, body: wire.Message
    ) -> MirrorRequest:
        self._number += 1
        self._requests[self._number] = piece
        return MirrorRequest(request_type, body, self._number)

    def _begin(self, instance: str, plan: wire.SnapshotPlan) -> None:
        if self._keeps_tree:
            tree = self._make_tree(plan.settings, instance)
            replay = ChangeReplay(tree)
        else:
            tree, replay = TransformTree(max_frames=2), None  # the least
        self._next = Copy(instance, plan, tree, self._observer, replay)
        self.snapshots += 1
        self._wants_plan = False
        self._waiting.keep_only(instance)

    def _take_missed(self, messages: list[bytes], last: int) -> None:
        """`last`: the last number that the server has sent."""
        copy = self._copy
        assert copy is not None
        if self._waiting.asked_until > last:
            self.contradicted()
        elif not messages:  # the server has evicted them, so the gap cannot be closed
            self.restart()
        else:
            self._waiting.close_gap(copy, messages)

    def _apply(self, copy: Copy, message: wire.StreamMessage) -> None:
        try:
            copy.apply(message)
        except TransformException:  # the copy cannot hold it: a new one may
            self.restart()

    def _advance(self) -> None:
        """Apply the messages that wait, as far as they follow each other."""
        copy = self._copy
        if copy is None or copy.loading:
            return
        while (message := self._waiting.take_next(copy.seq)) is not None:
            self._apply(copy, message)
            if self._copy is not copy:
                return
        if copy is self._next and copy.is_complete:
            self._live, self._next = copy, None
