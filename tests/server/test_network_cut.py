"""A network that drops all packets without a reset: what docs/explanation/outages.md promises.

The proxy delivers afterwards what was sent meanwhile, as TCP's retransmissions do, unless one of
the two sides has given the connection up.
"""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.processes.servers import ServerProcess
from tests.processes.tcp_proxy import TcpProxy
from tests.support.waiting import wait_until
from zenoh_tf import StampedTransform, Transform
from zenoh_tf.errors import OutcomeUnknown, ServerUnavailable
from zenoh_tf_client import Broadcaster, Mirror, TransformClient


def link(child: str, stamp_ns: int) -> StampedTransform:
    return StampedTransform("map", child, stamp_ns, Transform())


def newest(tf: TransformClient | Mirror, child: str = "base") -> int:
    return tf.lookup_latest_transform("map", child).newest_stamp_ns


@pytest.fixture
def proxy(server: ServerProcess) -> Iterator[TcpProxy]:
    with TcpProxy(server.endpoint) as proxy:
        yield proxy


@pytest.fixture
def tf(proxy: TcpProxy, client: TransformClient) -> Iterator[TransformClient]:
    """A client behind the proxy; `client` is not."""
    client.set_transform(link("base", 1))
    with TransformClient.connect(proxy.endpoint, timeout_s=1.0, reads="query") as tf:
        yield tf


def cut(proxy: TcpProxy, mirror: Mirror) -> None:
    wait_until(lambda: mirror.synced)
    proxy.hold()
    wait_until(lambda: mirror.age_s > 0.5, "it does not age")


def arrives(sensor: Broadcaster, client: TransformClient, stamp_ns: int) -> bool:
    """Send a dynamic transform, and return whether the server has one of its stamp."""
    sensor.send(link("tool", stamp_ns))
    return newest(client, "tool") == stamp_ns


def test_a_short_cut(proxy: TcpProxy, tf: TransformClient, client: TransformClient) -> None:
    with tf.mirror() as mirror, tf.broadcaster("sensor") as sensor:
        sensor.send(link("tool", 1))
        assert client.can_transform("map", "tool", timeout_s=100)
        cut(proxy, mirror)
        with pytest.raises(OutcomeUnknown):
            tf.set_transform(link("base", 2))
        with pytest.raises(ServerUnavailable):
            newest(tf)
        with pytest.raises(ServerUnavailable):
            tf.lookup_transform("map", "base", 9, timeout_s=0.5)
        sensor.send_static(link("mount", 0))
        sensor.send(link("tool", 2))
        wait_until(lambda: not mirror.synced, "it does not notice")
        assert newest(mirror) == 1
        with pytest.raises(ServerUnavailable):
            mirror.lookup_latest_transform("map", "base", max_age_s=0.1)
        client.set_transform(link("base", 3))
        proxy.release()
        assert client.can_transform("map", "mount", timeout_s=100)
        wait_until(lambda: arrives(sensor, client, 3))
        wait_until(lambda: mirror.synced and mirror.age_s < 0.5)
        assert newest(mirror) == newest(tf) == 3
        tf.set_transform(link("base", 4))
        mirror.wait_for(tf.last_receipt, 100)
        assert newest(mirror) == 4
    # The write of stamp 2 had expired when it arrived.
    assert (client.frame("base").samples, client.frame("base").rewritten) == (3, 0)


@pytest.mark.slow
def test_a_cut_that_ends_the_connection(
    proxy: TcpProxy, tf: TransformClient, client: TransformClient
) -> None:
    """Zenoh gives it up after 10 s; then the server counts as dead."""
    with tf.mirror() as mirror, tf.broadcaster("sensor") as sensor:
        sensor.send_static(link("camera", 0))
        sensor.send(link("tool", 1))
        assert client.can_transform("camera", "tool", timeout_s=100)
        announcer = sensor._announcer
        assert announcer is not None
        wait_until(lambda: announcer._present)
        cut(proxy, mirror)
        sensor.send_static(link("mount", 0))
        sensor.send(link("tool", 2))
        wait_until(lambda: not announcer._present, "the connection does not end")
        with pytest.raises(ServerUnavailable):
            newest(tf)
        with pytest.raises(ServerUnavailable):
            tf.set_transform(link("never", 1))
        wait_until(lambda: not mirror.synced, "the mirror does not notice")
        assert newest(mirror) == 1
        client.set_transform(link("base", 3))
        sensor.send(link("tool", 3))
        proxy.release()
        assert client.can_transform("map", "mount", timeout_s=100)
        wait_until(lambda: arrives(sensor, client, 4))
        wait_until(lambda: mirror.synced and newest(mirror) == 3)
        tf.set_transform(link("base", 4))
        mirror.wait_for(tf.last_receipt, 100)
        assert newest(mirror) == 4
    assert sorted(client.frames()) == ["base", "camera", "map", "mount", "tool"]
