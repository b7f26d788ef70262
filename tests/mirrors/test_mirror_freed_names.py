"""Mirrors that are made while names lose their ids, at the limit of frames, are exact."""

from __future__ import annotations

import threading

import pytest

from tests.conftest import StartServer
from tests.support.small_robot import link
from zenoh_tf import wire
from zenoh_tf.steps import Steps
from zenoh_tf_client import TransformClient
from zenoh_tf_client.mirror.source import MirrorSource

SECOND = 1_000_000_000


def test_transactions_in_a_mirror_on_a_frame_that_came_back(client: TransformClient) -> None:
    client.set_transform(link("P", "F", 1))
    client.set_transform(link("Q", "G", 1))
    client.remove_frame("G")
    client.remove_frame("Q")
    with client.mirror() as mirror:
        client.set_transform(link("Q", "F", 2))
        client.set_transform(link("Q", "H", 2))
        mirror.wait_for()
        calls = []

        def move(tx: object) -> None:
            calls.append(tx)
            tx.lookup_transform("H", "F")  # type: ignore[attr-defined]
            tx.set_transform(link("Q", "F", 3))  # type: ignore[attr-defined]

        mirror.run_transaction(move)
        assert len(calls) == 1


def test_the_mirror_of_a_server_whose_names_lose_their_ids(
    start_server: StartServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    server = start_server("--limit", "frames=16", "--cache-time", "1000s")
    with server.connect() as tf:

        def many(parent: str, begin_ns: int) -> None:  # about two pieces of a snapshot
            for first in range(0, 8000, 1000):
                rows = [link(parent, "F", begin_ns + i) for i in range(first, first + 1000)]
                tf.set_transforms_xact(rows)

        many("P", 10 * SECOND)
        many("R", 11 * SECOND)
        tf.set_transform(link("F", "Z", 10 * SECOND))
        for i in range(13):
            tf.set_transform(link("Z", f"visitor{i}", SECOND))
            tf.remove_frame(f"visitor{i}")
        first_piece = threading.Event()
        moved: list[int] = []
        ask = MirrorSource.ask

        def hold_back(
            self: MirrorSource, request_type: str, body: wire.Message, wait_s: float
        ) -> Steps[wire.Message]:
            request = wire.parse_snapshot_request(body) if request_type == "snapshot" else None
            if request is not None and request.after > 0 and not moved:
                assert first_piece.wait(10)
                moved.append(request.after)
                tf.remove_frame("P")
                tf.set_transform(link("R", "X", 10 * SECOND))
                tf.set_transform(link("R", "P", 10 * SECOND))
            reply = yield from ask(self, request_type, body, wait_s)
            if request is not None and request.after == 0:
                first_piece.set()
            return reply

        monkeypatch.setattr(MirrorSource, "ask", hold_back)
        with tf.mirror() as mirror:
            mirror.wait_for()
            assert moved
            for parent in ("P", "R", "X", "Z"):
                for stamp in (10 * SECOND, 10 * SECOND + 7999, 11 * SECOND):
                    asked = (parent, "F", stamp)
                    assert answer(mirror, *asked) == answer(tf, *asked), asked


def answer(tree: object, target: str, source: str, stamp_ns: int) -> object:
    try:
        found = tree.lookup_transform(target, source, stamp_ns)  # type: ignore[attr-defined]
    except Exception as error:
        return type(error).__name__, str(error)
    return found.stamp_ns, found.transform.translation.tolist()
