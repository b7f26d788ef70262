"""Which socket a Zenoh link has."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import pytest

from zenoh_tf._net import link_sockets

Pair = tuple[socket.socket, socket.socket]


@pytest.fixture
def pairs() -> Iterator[list[Pair]]:
    """Connections of TCP, both ends of each."""
    with ExitStack() as stack:
        listening = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
        found = []
        for _ in range(20):
            there = stack.enter_context(socket.create_connection(listening.getsockname()))
            found.append((stack.enter_context(listening.accept()[0]), there))
        yield found


def ends(pair: Pair) -> tuple[str, str]:
    here, there = (f"tcp/127.0.0.1:{end.getsockname()[1]}" for end in pair)
    return here, there


def test_the_socket_of_a_new_link_is_found_without_asking_about_others(
    pairs: list[Pair], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int] = []
    borrowed = link_sockets._borrowed

    def count(fd: int) -> Any:
        asked.append(fd)
        return borrowed(fd)

    monkeypatch.setattr(link_sockets, "_borrowed", count)
    for pair in pairs:
        fd = pair[0].fileno()
        known = {int(name) for name in os.listdir("/proc/self/fd")} - {fd}
        asked.clear()
        found = link_sockets._find(*ends(pair), known)
        assert found is not None and found.fd == fd
        assert asked == [fd]


def test_a_link_may_have_the_file_of_one_that_has_ended(pairs: list[Pair]) -> None:
    known = {int(name) for name in os.listdir("/proc/self/fd")}
    for pair in pairs:
        found = link_sockets._find(*ends(pair), known)
        assert found is not None and found.fd == pair[0].fileno()


def test_no_socket_is_found_between_other_ends(pairs: list[Pair]) -> None:
    assert link_sockets._find(ends(pairs[0])[1], ends(pairs[1])[1]) is None
