"""A mirror's state machine against a simulated server and network: I/O-free, seeded."""

from __future__ import annotations

import random
from dataclasses import dataclass, field

import pytest

from tests.support.logged_trees import CACHE_S, FEW_FRAMES, Writer, logged, make_tree, state
from zenoh_tf import TransformTree, wire
from zenoh_tf._core import ChangeReplay
from zenoh_tf.errors import InvalidArgumentException, ServerBusy, ServerRestarted
from zenoh_tf.mirrors.mirroring import Mirroring, MirrorRequest
from zenoh_tf.mirrors.shared_bytes import SharedBytes
from zenoh_tf_server.streams.publisher import RecentMessages

SETTINGS = wire.TreeSettings(round(CACHE_S * 1e9), 64, 16, 255, 1000)


def mirror_tree(settings: wire.TreeSettings, instance: str) -> TransformTree:
    assert settings == SETTINGS
    return make_tree(max_log_bytes=1 << 16)  # so that `state` can read it


class Server:
    """A tree, its stream and its snapshots, without threads."""

    def __init__(self, instance: str, seed: int, kept_bytes: int, frees_ids: bool) -> None:
        self.instance = instance
        self.tree, self.log = logged(max_frames=FEW_FRAMES if frees_ids else 64)
        self.writer = Writer(self.tree, seed, visits=frees_ids)
        self.recent = RecentMessages(kept_bytes)
        self.last = self.log.start()
        self.clock_ns = 0
        self.states = {self.log.last: state(self.tree)}

    def write(self) -> None:
        self.writer.write()
        self.states[self.log.last] = state(self.tree)

    def publish(self) -> bytes:
        _, last, lost, changes = self.log.take(1 << 14)
        assert not lost
        self.clock_ns += 1
        first, self.last = self.last + 1, last
        message = wire.StreamMessage(self.instance, first, last, self.clock_ns, changes)
        data = wire.pack(wire.stream_body(message))
        if last >= first:
            self.recent.add(first, last, data)
        return data

    def reply(self, request: MirrorRequest) -> wire.Message:
        body = wire.unpack(wire.pack(request.body))
        if request.request_type == "missed":
            instance, first, _ = wire.parse_missed_request(body)
            if instance != self.instance:
                return self._error()
            fields = wire.missed_reply(self.recent.since(first, 2000), self.last)
        elif (asked := wire.parse_snapshot_request(body)) is None:
            seq, ever_reparented, bounds = self.log.plan_snapshot(300)
            plan = wire.SnapshotPlan(seq, ever_reparented, bounds, SETTINGS, self.clock_ns)
            fields = wire.snapshot_plan_reply(plan)
        else:
            if asked.instance != self.instance:
                return self._error()
            reached, frames = self.log.read_snapshot(asked.after, asked.until, 400)
            piece = wire.SnapshotPiece(asked.piece, reached, self.log.last, frames)
            fields = wire.snapshot_piece_reply(piece)
        return wire.unpack(wire.pack({"v": 1, "instance": self.instance, **fields}))

    def _error(self) -> wire.Message:
        return wire.error_reply(self.instance, ServerRestarted("another instance"))


@dataclass
class Network:
    """Delivers what a mirror asks and hears, late or not at all."""

    seed: int
    loss: float = 0.0
    kept_bytes: int = 1 << 20
    frees_ids: bool = False
    mirroring: Mirroring = field(
        default_factory=lambda: Mirroring(mirror_tree, room=SharedBytes(2 << 20))
    )

    def __post_init__(self) -> None:
        self.random = random.Random(self.seed)
        self.number = 0
        self.states: dict[str, dict[int, object]] = {}
        self.under_way: list[MirrorRequest] = []
        self.seen: list[tuple[str, int]] = []
        self.start_server()

    def start_server(self) -> None:
        self.number += 1
        seed = self.seed * 100 + self.number
        self.server = Server(f"server{self.number}", seed, self.kept_bytes, self.frees_ids)
        self.states[self.server.instance] = self.server.states  # type: ignore[assignment]

    def step(self, *, loss: float | None = None) -> None:
        loss = self.loss if loss is None else loss
        for _ in range(self.random.randrange(4)):
            self.server.write()
        data = self.server.publish()
        if self.random.random() >= loss:
            self.mirroring.received(data)
            self.check()
        self.under_way += self.mirroring.take_requests()
        while self.under_way and self.random.random() < 0.7:
            request = self.under_way.pop(self.random.randrange(len(self.under_way)))
            if self.random.random() < loss:
                self.mirroring.failed(request.number)
            elif self.random.random() < loss:
                busy = wire.error_reply(self.server.instance, ServerBusy("busy"))
                self.mirroring.answered(request.number, busy)
            else:
                self.mirroring.answered(request.number, self.server.reply(request))
            self.check()

    def check(self) -> None:
        """The mirror's tree must be one that the server has had, and never an earlier one."""
        mirroring = self.mirroring
        if mirroring.tree is None:
            return
        point = (mirroring.state.instance, mirroring.state.seq)
        known = self.states[mirroring.state.instance].get(mirroring.state.seq)
        if known is not None:  # else in the middle of a time jump, which takes two commits
            assert state(mirroring.tree) == known
        if self.seen and self.seen[-1][0] == point[0]:
            assert self.seen[-1][1] <= point[1]
        if not self.seen or self.seen[-1] != point:
            self.seen.append(point)

    def settle(self) -> None:
        """Go on without losses until the mirror has everything."""
        for _ in range(200):
            self.step(loss=0.0)
        for _ in range(60):
            self.mirroring.received(self.server.publish())
            self.under_way += self.mirroring.take_requests()
            while self.under_way:
                request = self.under_way.pop()
                self.mirroring.answered(request.number, self.server.reply(request))
        assert self.mirroring.state.synced
        assert self.mirroring.state.seq == self.server.log.last
        assert self.mirroring.state.clock_ns == self.server.clock_ns
        assert self.mirroring.tree is not None
        assert state(self.mirroring.tree) == state(self.server.tree)


@pytest.mark.parametrize("frees_ids", [False, True])
@pytest.mark.parametrize("seed", range(12))
def test_losses_are_repaired(seed: int, frees_ids: bool) -> None:
    network = Network(seed, loss=0.3, frees_ids=frees_ids)
    for _ in range(300):
        network.step()
    network.settle()
    assert network.mirroring.snapshots == 1
    assert network.mirroring.contradictions == 0  # its repeats are honest
    assert len(network.seen) > 20


@pytest.mark.parametrize("frees_ids", [False, True])
@pytest.mark.parametrize("seed", range(6))
def test_what_the_server_has_forgotten_takes_a_snapshot(seed: int, frees_ids: bool) -> None:
    network = Network(seed, loss=0.5, kept_bytes=3000, frees_ids=frees_ids)
    for _ in range(300):
        network.step()
    network.settle()
    assert network.mirroring.snapshots > 1


def test_the_old_copy_stays_until_the_new_one_is_complete() -> None:
    network = Network(3)
    network.settle()
    old = network.mirroring.tree
    assert old is not None
    before = state(old)
    network.mirroring.restart()
    assert not network.mirroring.state.synced
    assert network.mirroring.tree is old
    while network.mirroring.tree is old:
        assert state(old) == before
        network.step()
    assert network.mirroring.snapshots == 2


def test_too_many_waiting_messages_are_given_up() -> None:
    network = Network(4, mirroring=Mirroring(mirror_tree, room=SharedBytes(40_000)))
    for _ in range(200):  # nobody answers the plan
        network.server.write()
        network.mirroring.received(network.server.publish())
    network.settle()


def test_a_tree_with_one_mutex_is_no_mirror() -> None:
    """Its lookups take that mutex, and are not validated; a replay does not take it."""
    with pytest.raises(InvalidArgumentException, match="'giant' cannot be a mirror") as caught:
        ChangeReplay(TransformTree(concurrency="giant"))
    assert caught.value.field == "concurrency"


def test_late_replies_are_ignored() -> None:
    network = Network(5)
    (request,) = network.mirroring.take_requests()
    assert network.mirroring.take_requests() == []
    network.mirroring.restart()
    network.mirroring.answered(request.number, network.server.reply(request))
    network.mirroring.failed(request.number)
    assert len(network.mirroring.take_requests()) == 1
