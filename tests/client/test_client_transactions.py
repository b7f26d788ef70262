"""Transactions of a client: they see one state, and commit only if it is unchanged."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.processes.servers import ServerProcess
from zenoh_tf.errors import (
    InvalidArgumentException,
    TransactionConflict,
)

from .test_client import S, fill, link

pytestmark = pytest.mark.usefixtures("either_client")


def test_transaction_commits_or_conflicts(server: ServerProcess) -> None:
    with server.connect() as tf, server.connect() as rival:
        fill(tf)
        with tf.transaction() as tx:
            seen = tx.lookup_latest_transform_xact("map", "base")
            tx.set_transforms_xact([link("map", "odom", 6 * S, 6.0), link("map", "goal", 6 * S)])
            kept_back = tf.lookup_latest_transform_xact("map", "base")
            assert kept_back.newest_stamp_ns == seen.newest_stamp_ns
            np.testing.assert_allclose(
                kept_back.transform.pose(), seen.transform.pose(), atol=1e-12
            )
        assert tf.lookup_transform("map", "goal").stamp_ns == 6 * S

        with pytest.raises(TransactionConflict) as caught, tf.transaction() as tx:
            tx.lookup_latest_transform_xact("map", "base")
            rival.set_transform(link("odom", "base", 7 * S))
            tx.set_transform(link("map", "never", 6 * S))
        assert caught.value.frame == "base"
        assert "never" not in tf.frames()

        # What was not read may change.
        with tf.transaction() as tx:
            tx.lookup_latest_transform_xact("map", "odom")
            rival.set_transform(link("odom", "base", 8 * S))
            tx.set_transform(link("map", "ever", 6 * S))
        assert "ever" in tf.frames()


def test_transaction_sees_one_state_or_conflicts(server: ServerProcess) -> None:
    with server.connect() as tf, server.connect() as rival:
        fill(tf)
        with pytest.raises(TransactionConflict), tf.transaction() as tx:
            tx.lookup_latest_transform_xact("map", "base")
            rival.set_transform(link("odom", "base", 7 * S))
            tx.lookup_latest_transform_xact("odom", "base")
        # Two reads of different links: noticed at the end, though nothing is written.
        with pytest.raises(TransactionConflict), tf.transaction() as tx:
            tx.lookup_latest_transform_xact("map", "odom")
            rival.set_transform(link("map", "odom", 7 * S))
            tx.lookup_latest_transform_xact("odom", "base")
        # That a frame is missing is something read as well.
        with pytest.raises(TransactionConflict), tf.transaction() as tx:
            assert not tx.can_transform("map", "object")
            rival.set_transform(link("map", "object", 7 * S))
            tx.set_transform(link("odom", "object", 7 * S))
        with pytest.raises(InvalidArgumentException), tf.transaction() as tx:
            tx.set_transform(link("map", "a", 1 * S))
            tx.set_transform(link("map", "b", 1 * S), static=True)
        assert "a" not in tf.frames()


def test_an_exception_over_reads_of_two_instants_is_a_conflict(server: ServerProcess) -> None:
    with server.connect() as tf, server.connect() as rival:
        fill(tf)
        attempts = []

        def compare(tx: Any) -> None:
            first = tx.lookup_latest_transform_xact("map", "odom").stamp_ns
            attempts.append(first)
            if len(attempts) < 3:
                stamp_ns = first + S
                rival.set_transforms_xact([link("map", a, stamp_ns) for a in ("odom", "twin")])
            assert tx.lookup_latest_transform_xact("map", "twin").stamp_ns == first, "they differ"

        rival.set_transforms_xact([link("map", "odom", 10 * S), link("map", "twin", 10 * S)])
        tf.run_transaction(compare)
        assert attempts == [10 * S, 11 * S, 12 * S]

        def fails(tx: Any) -> None:
            tx.lookup_latest_transform_xact("map", "odom")
            tx.lookup_latest_transform_xact("map", "twin")
            tx.set_transform(link("map", "never", 10 * S))
            raise KeyError("of its own")

        with pytest.raises(KeyError, match="of its own"):
            tf.run_transaction(fails)
        assert "never" not in tf.frames()


def test_run_transaction_tries_again(server: ServerProcess) -> None:
    with server.connect() as tf, server.connect() as rival:
        fill(tf)
        attempts = []

        def move(tx: Any) -> float:
            x = float(tx.lookup_latest_transform_xact("map", "odom").transform.translation[0])
            attempts.append(x)
            if len(attempts) < 3:
                rival.set_transform(link("map", "odom", 3 * S, x + 100))
            tx.set_transform(link("map", "odom", 3 * S, x + 1))
            return x

        assert tf.run_transaction(move) == 203.0
        assert attempts == [3.0, 103.0, 203.0]
        assert tf.lookup_transform("map", "odom").transform.translation[0] == 204.0

        def never(tx: Any) -> None:
            tx.lookup_latest_transform_xact("map", "odom")
            rival.set_transform(link("map", "odom", 3 * S))
            tx.set_transform(link("map", "odom", 3 * S))

        with pytest.raises(TransactionConflict) as caught:
            tf.run_transaction(never, attempts=2)
        assert "2 attempts" in vars(caught.value)["__notes__"][0]
