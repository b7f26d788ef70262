"""Endpoints are checked before Zenoh sees them, and shown without their options."""

from __future__ import annotations

import json

import pytest

from zenoh_tf._net import zenoh_config
from zenoh_tf.errors import InvalidArgumentException


@pytest.mark.parametrize(
    "endpoint",
    [
        "tcp/127.0.0.1:7447",
        "tcp/localhost:0",
        "udp/[::1]:65535",
        "quic/robot.local:7447",
        "tls/[fe80::1%eth0]:7447#listen_private_key=/etc/key.pem;listen_certificate=/etc/c.pem",
        "tcp/0.0.0.0:7447?prio=1-7#iface=eth0",
        "ws/127.0.0.1:80",
        "unixsock-stream/run/zenoh.sock",
    ],
)
def test_endpoints_that_zenoh_understands(endpoint: str) -> None:
    zenoh_config.check_endpoint(endpoint)


@pytest.mark.parametrize(
    ("endpoint", "reason"),
    [
        ("", "no protocol"),
        ("foo", "no protocol"),
        ("tcp/", "no protocol"),
        ("tcp/#iface=lo", "no protocol"),
        ("127.0.0.1:7447", "no protocol"),
        ("/127.0.0.1:7447", "unknown protocol"),
        ("bogus/x", "unknown protocol"),
        ("TCP/127.0.0.1:7447", "unknown protocol"),
        ("tcp/127.0.0.1", "tcp/HOST:PORT"),
        ("tcp/:7447", "tcp/HOST:PORT"),
        ("tcp/[::1:7447", "tcp/HOST:PORT"),
        ("tcp/[::1]", "tcp/HOST:PORT"),
        ("tcp/127.0.0.1:", "port"),
        ("tcp/127.0.0.1:http", "port"),
        ("tcp/127.0.0.1:65536", "port"),
        ("tcp/127.0.0.1:-1", "port"),
        ("tcp/127.0.0.1:\u0661", "port"),
    ],
)
def test_endpoints_that_it_does_not(endpoint: str, reason: str) -> None:
    with pytest.raises(InvalidArgumentException, match=reason) as caught:
        zenoh_config.check_endpoint(endpoint)
    assert caught.value.field == "endpoint"


def test_secrets_are_not_shown() -> None:
    secret = "tls/host:1?prio=1#listen_private_key=/home/me/key.pem"
    assert zenoh_config.address(secret) == "tls/host:1"
    assert zenoh_config.address("tls/host:1#key=a?b") == "tls/host:1"
    with pytest.raises(InvalidArgumentException) as caught:
        zenoh_config.check_endpoint("tls/host#listen_private_key=/home/me/key.pem")
    assert "key.pem" not in str(caught.value)


def test_discovery_and_shared_memory_are_off() -> None:
    for config in (
        zenoh_config.client(["tcp/127.0.0.1:1"], 2.0, max_message_bytes=7),
        zenoh_config.router(["tcp/127.0.0.1:1"], max_sessions=3),
    ):
        for key in (
            "scouting/multicast/enabled",
            "scouting/gossip/enabled",
            "transport/shared_memory/enabled",
        ):
            assert json.loads(config.get_json(key)) is False, key
