"""A network's silence does not mean that a tree is free."""

from __future__ import annotations

import concurrent.futures
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest
import zenoh

from tests.processes.servers import START_TIMEOUT_S, ServerProcess
from tests.processes.tcp_proxy import TcpProxy
from zenoh_tf._net import keys, zenoh_config
from zenoh_tf_server.process import tree_claim
from zenoh_tf_server.process.network import NetworkError
from zenoh_tf_server.process.tree_claim import Claim, TreeTaken


@pytest.fixture
def proxy(server: ServerProcess, monkeypatch: pytest.MonkeyPatch) -> Iterator[TcpProxy]:
    monkeypatch.setattr(tree_claim, "_QUERY_TIMEOUT_S", 0.2)
    with TcpProxy(server.endpoint) as proxy:
        yield proxy


def test_an_answer_that_is_late_counts(proxy: TcpProxy) -> None:
    with zenoh.open(zenoh_config.client([proxy.endpoint], 5.0)) as session:
        proxy.hold()
        timer = threading.Timer(1.0, proxy.release)
        timer.start()
        with pytest.raises(TreeTaken):
            Claim(session, "main", "1")
        timer.join()


def test_silence_is_an_error(proxy: TcpProxy, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tree_claim, "_SILENT_S", 0.5)
    with zenoh.open(zenoh_config.client([proxy.endpoint], 5.0)) as session:
        proxy.hold()
        with pytest.raises(NetworkError, match=r"whether another server has tree 'main'"):
            Claim(session, "main", "1")
        proxy.release()
        Claim(session, "other", "1").close()


def test_of_two_candidates_one_serves(server: ServerProcess) -> None:
    """However long the other takes to yield, as on a busy machine."""
    with zenoh.open(zenoh_config.client([server.endpoint], 5.0)) as session:
        slow = session.liveliness().declare_token(keys.candidate("two", "1"))
        with pytest.raises(TreeTaken):
            Claim(session, "two", "2")
        with ThreadPoolExecutor() as pool:
            claimed = pool.submit(Claim, session, "two", "0")
            with pytest.raises(concurrent.futures.TimeoutError):
                claimed.result(3.0)
            slow.undeclare()
            claimed.result(START_TIMEOUT_S).close()


def test_a_candidate_yields_to_one_that_has_not_seen_it(server: ServerProcess) -> None:
    with zenoh.open(zenoh_config.client([server.endpoint], 5.0)) as session:
        first = session.liveliness().declare_token(keys.candidate("two", "1"))
        with ThreadPoolExecutor() as pool:
            claimed = pool.submit(Claim, session, "two", "0")
            serves = session.liveliness().declare_token(keys.server("two", "1"))
            first.undeclare()
            with pytest.raises(TreeTaken):
                claimed.result(START_TIMEOUT_S)
        left = session.liveliness().get(keys.candidates("two"))
        assert [str(reply.ok) for reply in left] == []
        serves.undeclare()


def test_a_claim_is_a_candidate_until_it_serves(server: ServerProcess) -> None:
    with zenoh.open(zenoh_config.client([server.endpoint], 5.0)) as session:

        def tokens(key_expr: str) -> set[str]:
            replies = session.liveliness().get(key_expr)
            return {str(reply.ok.key_expr) for reply in replies if reply.ok}

        claim = Claim(session, "two", "1")
        assert tokens(keys.candidates("two")) == {keys.candidate("two", "1")}
        assert tokens(keys.servers("two")) == set()
        claim.serve()
        assert tokens(keys.candidates("two")) == set()
        assert tokens(keys.servers("two")) == {keys.server("two", "1")}
        claim.close()
        assert tokens(keys.servers("two")) == set()
