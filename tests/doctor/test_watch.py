"""A server's tree that is watched on and on, from one copy."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Generator, Iterator

import pytest

from tests.conftest import StartServer
from zenoh_tf import ServerUnavailable, StampedTransform, Transform
from zenoh_tf_client import TransformClient
from zenoh_tf_tools.cli import observations
from zenoh_tf_tools.cli.observations import watch
from zenoh_tf_tools.doctor import TreeFacts
from zenoh_tf_tools.doctor.observation import Seen
from zenoh_tf_tools.tree_observer import TreeObserver

S = 10**9
Looks = Generator[TreeFacts, None, None]


@pytest.fixture
def observers(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[TreeObserver]]:
    """All observers that are made, each with a copy of the tree."""
    made: list[TreeObserver] = []

    class Counted(TreeObserver):
        def __init__(self, client: TransformClient, timeout_s: float) -> None:
            super().__init__(client, timeout_s)
            made.append(self)

    monkeypatch.setattr(observations, "TreeObserver", Counted)
    yield made
    assert all(observer._feed.closed for observer in made)


def seen(facts: TreeFacts) -> Seen:
    """What was seen of base."""
    (link,) = (link for link in facts.links if link.frame.name == "base")
    assert link.seen is not None
    return link.seen


def publish(tf: TransformClient, count: Iterator[int], samples: int) -> None:
    for number in itertools.islice(count, samples):
        X = Transform((number, 0, 0))
        tf.set_transform(StampedTransform("map", "base", number * S // 10, X), "wheels")


def until(looks: Looks, arrivals: int) -> TreeFacts:
    """The first facts that have so many samples."""
    return next(facts for facts in looks if seen(facts).timing.arrivals >= arrivals)


@pytest.mark.timeout(120)
def test_a_window_grows_and_begins_again(
    client: TransformClient, observers: list[TreeObserver], monkeypatch: pytest.MonkeyPatch
) -> None:
    count = itertools.count(1)
    publish(client, count, 3)
    with contextlib.closing(watch(client, 0.01, 30.0)) as looks:
        assert seen(next(looks)).timing.arrivals == 0
        publish(client, count, 4)
        until(looks, 4)
        publish(client, count, 5)
        facts = until(looks, 9)
        assert seen(facts).timing.arrivals == 9
        assert (seen(facts).authority, seen(facts).parent) == ("wheels", "map")
        (link,) = (link for link in facts.links if link.frame.name == "base")
        assert facts.grown(link, "samples") == 9
        last_ns = seen(facts).timing.last_ns
        monkeypatch.setattr(observations, "_WINDOW_S", 0.0)
        fresh = next(looks)
        # It is still known when the last sample came.
        assert (seen(fresh).timing.arrivals, seen(fresh).timing.last_ns) == (0, last_ns)
        assert fresh.observed_s < facts.observed_s
        (link,) = (link for link in fresh.links if link.frame.name == "base")
        assert fresh.grown(link, "samples") == 0
        monkeypatch.setattr(observations, "_WINDOW_S", 60.0)
        publish(client, count, 2)
        assert seen(until(looks, 2)).timing.arrivals == 2
    assert len(observers) == 1


def test_what_came_before_is_compared_with(client: TransformClient) -> None:
    """A jump is one, though the samples that it is compared with are of the window before."""
    count = itertools.count(1)
    publish(client, count, 12)
    with contextlib.closing(watch(client, 0.01, 30.0)) as looks:
        next(looks)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(observations, "_WINDOW_S", 0.0)
            assert seen(next(looks)).motion.jumps == 0
        stamped = StampedTransform("map", "base", next(count) * S // 10, Transform((500, 0, 0)))
        client.set_transform(stamped, "wheels")
        assert seen(until(looks, 1)).motion.jumps == 1


@pytest.mark.timeout(120)
def test_another_server_is_copied_again(
    start_server: StartServer, observers: list[TreeObserver]
) -> None:
    server = start_server()
    count = itertools.count(1)
    with server.connect() as tf:
        publish(tf, count, 3)
        with contextlib.closing(watch(tf, 0.01, 30.0)) as looks:
            next(looks)
            server.kill()
            start_server(endpoint=server.endpoint)
            while True:
                with contextlib.suppress(ServerUnavailable):
                    publish(tf, count, 3)
                    break
            while len(observers) == 1:
                next(looks)
            publish(tf, count, 2)
            assert seen(until(looks, 2)).timing.arrivals == 2
    assert len(observers) == 2
