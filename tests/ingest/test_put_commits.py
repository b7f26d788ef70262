"""Puts of a turn: decoded and committed together, each a transaction of its own."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterator
from typing import Any

import msgpack
import numpy as np
import pytest

from zenoh_tf import TransformTree, wire
from zenoh_tf._core import TransformRows, decode_puts
from zenoh_tf.errors import InvalidArgumentException, LimitExceeded
from zenoh_tf_server.ingest.future_stamps import FutureStamps
from zenoh_tf_server.ingest.put_commits import PutCommits
from zenoh_tf_server.ingest.put_queues import Put
from zenoh_tf_server.limits import Limits
from zenoh_tf_server.requests.service import Service
from zenoh_tf_server.requests.surroundings import ALONE, Surroundings

POSE = (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0)
LIMITS = Limits(rows=100, message_bytes=1 << 20)


def rows(*links: tuple[str, str, int]) -> TransformRows:
    return TransformRows.of_tuples((parent, child, stamp, POSE) for parent, child, stamp in links)


def message(*links: tuple[str, str, int], **more: Any) -> bytes:
    return wire.pack(wire.commit_body(wire.Commit(rows(*links))) | more)


def decode(*messages: bytes) -> list[TransformRows | None]:
    return decode_puts(list(messages), LIMITS.rows, LIMITS.decoded_bytes)


def same(one: TransformRows, other: TransformRows) -> bool:
    return one.names == other.names and one.columns() == other.columns()


# --- decoding


def test_plain_messages_are_decoded_as_the_general_decoder_does() -> None:
    names = ["map", "é", "\U0001f916", "x" * 40, "y" * 300]
    payload = message(*(("map", name, n) for n, name in enumerate(names[1:])))
    (found,) = decode(payload)
    assert found is not None
    general = wire.parse_commit(wire.unpack(payload)).rows
    assert found.name_count == 5
    assert same(found, general)
    assert found.names == names and found.newest_stamp == 3
    assert same(found[1:3], general[1:3])


def test_fields_may_have_any_order() -> None:
    body = wire.unpack(message(("map", "base", 1)))
    for fields in (dict(reversed(body.items())), dict(sorted(body.items()))):
        (found,) = decode(wire.pack(fields))
        assert found is not None and found.names == ["map", "base"]


@pytest.mark.parametrize("names", [b"\xed\xa0\x80", b"\xc0\xaf", b"\xf4\x90\x80\x80", b"a\xff"])
def test_names_that_are_not_utf8_are_left_to_the_general_decoder(names: bytes) -> None:
    good = message(("map", "n" * len(names), 1))
    (found,) = decode(good.replace(b"n" * len(names), names))
    assert found is None


def test_other_messages_are_left_to_the_general_decoder() -> None:
    plain = message(("map", "base", 1))
    body = wire.unpack(plain)
    others = [
        b"",
        plain[:-1],
        plain + b"\xc0",
        message(("map", "base", 1), announce=True),
        wire.pack(body | {"v": 2}),
        wire.pack(body | {"parent": body["parent"] * 2}),
        wire.pack(body | {"parent": b"\x09\0\0\0"}),  # there are two names
        wire.pack(body | {"names": "base"}),
        wire.pack({name: value for name, value in body.items() if name != "pose"}),
        message(*(("map", f"f{n}", 1) for n in range(101))),  # a row above the limit
        wire.pack(body | {"names": ["map", "base", *(str(n) for n in range(400))]}),
        plain.replace(b"\xa5child", b"\xa5stamp", 1),  # a field twice
    ]
    assert decode(*others) == [None] * len(others)
    assert decode_puts([plain], 100, 1000) == [None]  # of more bytes when it is decoded
    assert decode_puts([None], 100, 1 << 20) == [None]


def test_every_damaged_message_is_refused_or_decoded_alike() -> None:
    """The native decoder accepts nothing that the general one would not, nor anything else."""
    plain = message(("map", "base", 1), ("base", "é", 2))
    chance = np.random.default_rng(1)
    damaged = [plain[:cut] for cut in range(len(plain))]
    for at in range(len(plain)):
        for value in chance.integers(0, 256, 6):
            damaged.append(plain[:at] + bytes([value]) + plain[at + 1 :])
    accepted = 0
    for payload, found in zip(damaged, decode(*damaged), strict=True):
        if found is not None:
            accepted += 1
            assert same(found, wire.parse_commit(wire.unpack(payload)).rows)
    assert accepted > 100  # numbers of the columns, and letters


def test_a_forged_count_of_names_claims_no_memory() -> None:
    body = wire.unpack(message(("map", "base", 1)))
    del body["v"], body["names"]
    forged = b"\x86\xa1v\x01\xa5names\xdd\xff\xff\xff\xff" + msgpack.packb(body)[1:]
    assert decode(forged) == [None]


# --- committing


class Committer:
    """A service with what commits its puts."""

    def __init__(self, future: FutureStamps, around: Surroundings = ALONE) -> None:
        self.tree = TransformTree()
        self.loop = asyncio.new_event_loop()
        self.service = Service(self.tree, "main", "i", LIMITS, self.loop, around=around)
        service = self.service
        self.commits = PutCommits(
            service.commit_puts, service.puts, service.refusals, LIMITS, service.clocks, future
        )

    def run(self, *puts: Put) -> None:
        self.commits.run(list(puts))

    def close(self) -> None:
        self.service.close()
        self.loop.close()

    def record(self, authority: str) -> dict[str, Any]:
        records = self.service.info_requests.authorities()
        return next(record for record in records if record["name"] == authority)


@pytest.fixture
def made() -> Iterator[Committer]:
    committer = Committer(FutureStamps())
    yield committer
    committer.close()


def put_of(authority: str, payload: Any, static: bool = False) -> Put:
    return Put(authority, static, payload, 100, time.time_ns())


def test_a_refused_put_harms_no_other_of_its_turn(made: Committer) -> None:
    made.run(
        put_of("a", message(("map", "one", 1))),
        put_of("a", b"\xc1"),
        put_of("a", message(("map", "two", 1), ("two", "map", 1))),  # a cycle
        put_of("a", message(("map", "x" * 300, 1))),
        put_of("a", message(("map", "three", 1))),
        put_of("b", message(("map", "four", 1))),
    )
    assert set(made.tree.frames()) == {"map", "one", "two", "three", "four"}
    counters = made.service.puts
    assert (counters.puts, counters.put_transforms, counters.bad_puts) == (4, 4, 2)
    record = made.record("a")
    assert (record["refused"], record["stored"]) == (1 + 1 + 1, 3)
    assert record["refused_by_reason"] == {"message": 1, "cycle": 1, "long_name": 1}
    assert made.record("b")["refused"] == 0
    assert "LimitExceeded" in record["last_refusal"]


def test_the_last_refusal_is_that_of_the_last_put(made: Committer) -> None:
    """Also where one has no rows, and another is refused by the tree."""
    rows_of_a_loop, no_message = message(("map", "map", 1)), b"\xc1"
    made.run(put_of("a", rows_of_a_loop), put_of("a", no_message))
    made.run(put_of("b", no_message), put_of("b", rows_of_a_loop))
    assert made.record("a")["last_refusal"].startswith("ProtocolError")
    assert made.record("b")["last_refusal"].startswith("InvalidArgumentException")


def test_puts_of_an_authority_keep_their_order_over_kinds(made: Committer) -> None:
    puts = []
    for number in range(30):  # each replaces what the one before it has made
        static = number % 3 == 1
        payload = message(("map", "base", number))
        puts.append(put_of("a", rows(("map", "base", number)) if number % 2 else payload, static))
    made.run(*puts)
    info = made.tree.frame("base")
    assert (info.static, info.newest_stamp_ns, info.switched) == (False, 29, 20)
    assert info.samples == 1 and made.service.puts.puts == 30


def test_a_bad_row_costs_itself(made: Committer) -> None:
    mixed = put_of("a", rows(("map", "base", 1), ("map", "map", 1)))
    bad = put_of("a", message(("", "base", 2)))
    made.run(put_of("a", message(("map", "old", 1))), mixed, bad, put_of("a", rows(("m", "n", 2))))
    assert sorted(made.tree.frames()) == ["base", "m", "map", "n", "old"]
    counters = made.service.puts
    assert (counters.puts, counters.put_transforms, counters.bad_puts) == (3, 3, 1)
    assert made.record("a")["refused_by_reason"] == {"own_parent": 1, "empty_name": 1}
    assert "'base'" in made.record("a")["last_refusal"]
    assert made.tree.stats()["commits"] == 3


def test_rows_that_are_too_old_or_from_the_future_are_counted(made: Committer) -> None:
    now_ns = time.time_ns()
    far_ns = now_ns + 10**13
    made.run(
        put_of("a", message(("map", "base", now_ns))),
        put_of("a", message(("map", "base", 1), ("map", "base", far_ns), ("map", "tip", now_ns))),
    )
    counters = made.service.puts
    assert (counters.puts, counters.put_transforms, counters.dropped_as_too_old) == (2, 2, 1)
    assert made.record("a")["refused"] == 1
    assert "--max-future-s" in made.record("a")["last_refusal"]
    assert made.record("a")["clock_offset_max_s"] == pytest.approx(0, abs=5)


def test_stamps_from_the_future_are_stored_if_they_are_only_flagged() -> None:
    committer = Committer(FutureStamps(policy="flag"))
    stamp_ns = time.time_ns() + 10**13
    committer.run(put_of("a", message(("map", "base", stamp_ns), ("map", "tip", 1))))
    assert committer.tree.frame("base").newest_stamp_ns == stamp_ns
    assert committer.service.puts.flagged_as_future == 1
    committer.close()


def test_what_listens_to_commits_sees_each_put() -> None:
    seen: list[tuple[list[str], bytes]] = []
    around = Surroundings(on_commit=lambda commit, stored: seen.append((commit.rows.names, stored)))
    made = Committer(FutureStamps(), around)
    made.run(
        put_of("a", message(("map", "base", 10**12))),
        put_of("a", b"\xc1"),
        put_of("a", message(("map", "base", 1), ("map", "tip", 1))),
    )
    made.close()
    assert seen == [(["map", "base"], b"\1"), (["map", "base", "tip"], b"\0\1")]


def test_stale_puts_are_counted_and_named(made: Committer) -> None:
    made.commits.count_stale([put_of("a", b""), put_of("a", b""), put_of("b", b"")])
    counters = made.service.puts
    assert (counters.dropped_by_queue, counters.dropped_as_stale) == (3, 3)
    assert made.record("a")["dropped_by_queue"] == 2


def test_commit_puts_checks_its_arguments() -> None:
    tree = TransformTree()
    with pytest.raises(InvalidArgumentException):
        tree._commit_puts([rows(("map", "base", 1))], [], [None])
    (outcome,) = tree._commit_puts([rows(("map", "x" * 300, 1))], ["a" * 300], [None])
    assert isinstance(outcome, LimitExceeded)
