"""Which socket a Zenoh link has."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import pytest

from zenoh_tf._zenoh import link_sockets

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
    ask = link_sockets._ends

    def count(fd: int) -> Any:
        asked.append(fd)
        return ask(fd)

    monkeypatch.setattr(link_sockets, "_ends", count)
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


@pytest.mark.parametrize("timeout_s", [None, 5.0])
def test_no_other_socket_of_the_process_is_changed(
    pairs: list[Pair], timeout_s: float | None
) -> None:
    """Python makes a descriptor non-blocking whose owner it does not know, if the program has set a
    default timeout."""
    others = [end for pair in pairs[1:] for end in pair]
    before = socket.getdefaulttimeout()
    socket.setdefaulttimeout(timeout_s)
    try:
        assert not link_sockets.shut("tcp/127.0.0.1:1", "tcp/127.0.0.1:2")
        assert link_sockets.shut(*ends(pairs[0]))
    finally:
        socket.setdefaulttimeout(before)
    assert pairs[0][1].recv(1) == b""
    assert all(os.get_blocking(end.fileno()) and end.gettimeout() is None for end in others)


def test_an_ipv6_socket_has_an_ipv4_link(pairs: list[Pair]) -> None:
    with socket.create_server(("::", 0), family=socket.AF_INET6, dualstack_ipv6=True) as listening:
        port = listening.getsockname()[1]
        with socket.create_connection(("127.0.0.1", port)) as there, listening.accept()[0] as here:
            found = link_sockets._find(
                f"tcp/127.0.0.1:{port}", f"tcp/127.0.0.1:{there.getsockname()[1]}"
            )
            assert found is not None and found.fd == here.fileno()
            assert found.free_bytes() > 0
            found.do_not_linger()
            linger = here.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8)
            assert linger == link_sockets._NO_LINGER
    assert found.free_bytes() == 0 and not found.shut()
