"""A tree read by another process: whole states only, and none of an owner that is gone."""

from __future__ import annotations

import ctypes
import os
import signal
import socket
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.processes import forks, torn
from tests.support.waiting import wait_until
from zenoh_tf import (
    StampedTransform,
    Transform,
    TransformTree,
    _core,
)
from zenoh_tf.shared_tree import AskServer, SharedTree

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="needs memfd")

ROOT = Path(__file__).resolve().parents[2]
LINK = StampedTransform("map", "base", 5, Transform((1, 2, 3)))


def shared() -> TransformTree:
    tree = TransformTree(max_frames=1000, _shared=True, _instance="one")
    tree._begin_lease(3600)
    return tree


class Owner:
    """A process that commits to a shared tree, and this process's view of it."""

    def __init__(self) -> None:
        mine, its = socket.socketpair()
        with mine, its:
            self.process = forks.Popen(
                [sys.executable, "-m", "tests.processes.shared_owner"], stdin=its.fileno(), cwd=ROOT
            )
            mine.settimeout(60)
            _, [fd], _, _ = socket.recv_fds(mine, 16, 1)
        self.tree = SharedTree(fd)
        os.close(fd)

    def stop(self) -> None:
        self.process.kill()
        self.process.wait()


@pytest.fixture
def owner() -> Iterator[Owner]:
    owner = Owner()
    yield owner
    owner.stop()


def x_of(answer: StampedTransform | AskServer) -> float | AskServer:
    return answer if isinstance(answer, AskServer) else answer.transform.translation[0]


def test_no_read_is_torn_while_another_process_commits(owner: Owner) -> None:
    tree = owner.tree
    answered = 0
    newest: set[int] = set()
    while answered < 20_000 or len(newest) < 50:
        x = x_of(tree.lookup_transform(torn.ROOT, torn.LEAF))
        latest = tree.lookup_latest_transform_xact(torn.ROOT, torn.LEAF)
        pairs = [(torn.ROOT, torn.LEAF), ("link3", torn.LEAF), (torn.ROOT, "link3")]
        several = tree.lookup_latest_transforms_xact(pairs)
        if not isinstance(latest, AskServer):
            assert latest.stamp_ns == latest.newest_stamp_ns
            newest.add(latest.stamp_ns)
        if not isinstance(several, AskServer):
            whole, lower, upper = (each.transform.translation[0] for each in several)
            assert whole == 0 and lower + upper == 0
        for value in (x, x_of(latest)):
            assert value in (0.0, AskServer.BUSY, AskServer.LAPSED)
            answered += value == 0.0


def test_a_killed_owner_is_not_believed(owner: Owner) -> None:
    wait_until(lambda: x_of(owner.tree.lookup_transform(torn.ROOT, torn.LEAF)) == 0.0)
    owner.stop()
    assert owner.tree.lease_left_s < 10
    # Its last lease ends; a writer that died in the middle of a commit leaves its frames busy.
    wait_until(lambda: owner.tree.lease_left_s <= 0)
    for read in (
        lambda: owner.tree.lookup_transform(torn.ROOT, torn.LEAF),
        lambda: owner.tree.lookup_latest_transform(torn.ROOT, torn.LEAF),
        lambda: owner.tree.chain(torn.ROOT, torn.LEAF),
        lambda: owner.tree.parent(torn.LEAF),
        lambda: owner.tree.frame(torn.LEAF),
        owner.tree.frames,
        lambda: owner.tree.lookup_transforms(torn.ROOT, torn.LEAF, None),
        lambda: owner.tree.lookup_velocity(torn.LEAF, torn.ROOT),
    ):
        assert read() in (AskServer.LAPSED, AskServer.BUSY)


def test_a_stopped_owner_is_believed_again_when_it_goes_on(owner: Owner) -> None:
    wait_until(lambda: x_of(owner.tree.lookup_transform(torn.ROOT, torn.LEAF)) == 0.0)
    owner.process.send_signal(signal.SIGSTOP)
    wait_until(lambda: owner.tree.lease_left_s <= 0)
    assert isinstance(owner.tree.lookup_transform(torn.ROOT, torn.LEAF), AskServer)
    owner.process.send_signal(signal.SIGCONT)
    wait_until(lambda: x_of(owner.tree.lookup_transform(torn.ROOT, torn.LEAF)) == 0.0)


@pytest.mark.parametrize("attempt", range(5))
def test_whatever_a_killed_owner_left_is_read_without_waiting(owner: Owner, attempt: int) -> None:
    time.sleep(0.01 * attempt)
    owner.stop()
    tree = owner.tree
    for _ in range(200):
        for i in range(torn.LINKS):
            assert tree.parent(f"link{i + 1}") in (f"link{i}", *AskServer)
        assert x_of(tree.lookup_transform(torn.ROOT, torn.LEAF)) in (0.0, *AskServer)


def test_a_keeper_extends_the_lease_while_python_is_busy() -> None:
    tree = TransformTree(max_frames=1000, _shared=True)
    tree.set_transform(LINK)
    reader = SharedTree(tree._region_fd())
    keeper = _core.LeaseKeeper(tree)
    assert reader.lookup_transform("map", "base") == LINK

    def end_s() -> float:
        return time.monotonic() + reader.lease_left_s

    before_s = end_s()
    ctypes.PyDLL(None).usleep(1_500_000)  # with the interpreter lock held
    assert end_s() > before_s + 0.3
    keeper.end()
    assert reader.lookup_transform("map", "base") is AskServer.LAPSED
    assert reader.lease_left_s < -1
    keeper.end()


def test_a_forked_child_does_not_end_the_lease() -> None:
    script = """
import os
from tests.sharing.test_shared_tree import LINK, SharedTree, shared
tree = shared()
tree.set_transform(LINK)
if child := os.fork():
    assert os.waitpid(child, 0)[1] == 0
    assert SharedTree(tree._region_fd()).lookup_transform("map", "base") == LINK
else:
    del tree
    os._exit(0)
"""
    forks.run([sys.executable, "-c", script], cwd=ROOT, check=True, timeout=150)


def test_a_tree_that_is_not_shared_has_no_region() -> None:
    assert TransformTree()._region_fd() == -1
