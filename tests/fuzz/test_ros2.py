"""Damaged messages of ROS 2 through real Zenoh: counted and named, and nothing else happens.

``FUZZ`` sets how many there are, and ``SEED`` repeats a run, as in test_fuzz.
"""

from __future__ import annotations

import os
import random
import struct
import sys
import time

import pytest
import zenoh

from tests.attack.processes import Server
from tests.processes.servers import TIMELESS
from tests.support.runs import seed
from zenoh_tf._core import TransformRows
from zenoh_tf._net import zenoh_config
from zenoh_tf.ros2 import attachment
from zenoh_tf.ros2.cdr import encode_tf_message
from zenoh_tf.ros2.keys import NO_HASH, TF_MESSAGE, parse_data
from zenoh_tf_client import TransformClient

from .seeds import Mutator

LONG = int(os.environ.get("FUZZ", "0"))
MESSAGES = min(LONG or 3000, 100_000)
SEED = seed(LONG)
GROWTH_MB = 40.0
LOG_BYTES = 2_000_000

pytestmark = pytest.mark.timeout(120 + MESSAGES // 100)

NUMBERS = (0.0, 1.0, float("nan"), float("inf"), 1e300)
NAMES = ("a", "b", "/a", "", "x" * 300, "é", "\x1b[31m", "fuzz/a")
KEYS = (
    "0/{topic}/{type}/{hash}",
    "0/robot{n}/{topic}/{type}/{hash}",
    "{n}{n}{n}{n}{n}{n}/{topic}/{type}/" + NO_HASH,
    "zero/{topic}/{type}/{hash}",
    "0/1st/{topic}/{type}/{hash}",
    "0/sp ace/{topic}/{type}/{hash}",
    "{topic}/{type}/{hash}",
    "0/{topic}/{type}",
    "0/@x/{topic}/{type}/{hash}",
    "{topic}",
    "robot{n}/{topic}",
    "ro bot/{topic}",
    "\x1b[31m/é/{topic}",
    "l" * 700 + "/{topic}",
)


class Draw:
    """Keys, payloads and attachments, some of them right."""

    def __init__(self, seed: object) -> None:
        self._random = random.Random(f"ros2 {seed}")
        self._mutator = Mutator(seed)

    def key(self, topic: str) -> str:
        key = self._random.choice(KEYS) if self._random.random() < 0.5 else KEYS[1]
        number = self._random.randrange(3)
        return key.format(topic=topic, type=TF_MESSAGE.chunk, hash=TF_MESSAGE.hash, n=number)

    def payload(self) -> bytes:
        draw = self._random
        rows = [
            (
                draw.choice(NAMES),
                draw.choice(NAMES),
                draw.choice((0, time.time_ns(), 2**31 * 10**9 - 1)),
                [draw.choice(NUMBERS) if draw.random() < 0.1 else float(i == 6) for i in range(7)],
            )
            for _ in range(draw.randrange(4))
        ]
        payload = encode_tf_message(TransformRows.of_tuples(rows))
        if draw.random() < 0.6:
            return self._mutator.damaged(payload)
        if draw.random() < 0.2:
            return payload[: draw.randrange(len(payload) + 1)]
        if draw.random() < 0.2:
            return struct.pack("<I", draw.choice((256, 0, 1 << 31))) + draw.randbytes(60)
        return payload

    def attachment(self) -> bytes | None:
        draw = self._random
        if draw.random() < 0.3:
            return None
        gid = bytes([draw.randrange(4)]) * 16
        right = attachment.encode(attachment.Attachment(draw.randrange(100), 1, gid))
        return self._mutator.damaged(right) if draw.random() < 0.4 else right


def test_damaged_messages_of_ros_break_nothing() -> None:
    print(f"\nSEED={SEED}")
    flags = (
        "--ros2",
        "--ros2-static-grace",
        "1s",
        "--limit",
        f"put_wait_ms={TIMELESS['put_wait_ms']}",
    )
    with Server(sys.executable, *flags) as server:
        config = zenoh_config.client([server.endpoint], 5.0)
        with TransformClient.connect(server.endpoint) as tf, zenoh.open(config) as session:
            moving, bad_attachments, bad_keys = play(tf, session, MESSAGES // 2)
            middle_mb = server.rss_mb()
            more = play(tf, session, MESSAGES - MESSAGES // 2, "second")
            wanted = [a + b for a, b in zip((moving, bad_attachments, bad_keys), more, strict=True)]
            stats = tf.stats()
            # All of them are accounted for. Static ones that repeat others need no put.
            assert stats["ros2_bad_keys"] == wanted[2]
            assert stats["ros2_bad_attachments"] == wanted[1]
            assert stats["puts"] + stats["bad_puts"] >= wanted[0]
            assert stats["bad_puts"] > MESSAGES // 20 and stats["puts"] > 100
            assert stats["dropped_by_queue"] == 0
            # A good message is heard beside it all.
            good = TransformRows.of_tuples([("good", "frame", 5, [1.0, 0, 0, 0, 0, 0, 1])])
            key = KEYS[0].format(topic="tf", type=TF_MESSAGE.chunk, hash=TF_MESSAGE.hash)
            session.put(key, encode_tf_message(good))
            assert tf.lookup_transform("good", "frame", timeout_s=30).transform.translation[0] == 1
            refusals = [each.last_refusal for each in tf.authorities() if each.refused]
            assert any("CDR field" in str(reason) for reason in refusals)
        assert server.rss_mb() - middle_mb < GROWTH_MB
        status, _ = server.terminate()
        log = server.log
    assert status == 0
    assert b"internal error" not in log and b"Traceback" not in log
    assert len(log) < LOG_BYTES


def play(
    tf: TransformClient, session: zenoh.Session, count: int, part: str = "first"
) -> tuple[int, int, int]:
    """Send messages, and wait until the server has had them. Returns how many of /tf it must have
    mistaken for messages, how many attachments were bad, and how many keys."""
    draw = Draw(f"{SEED} {part}")
    moving = bad_attachments = bad_keys = 0
    subscribed = [
        zenoh.KeyExpr(each.format(topic=topic))
        for topic in ("tf", "tf_static")
        for each in (f"**/{{topic}}/{TF_MESSAGE.chunk}/*", "**/{topic}")
    ]
    before = tf.stats()
    for number in range(count):
        topic = "tf_static" if number % 5 == 0 else "tf"
        key, mark = draw.key(topic), draw.attachment()
        session.put(
            key,
            draw.payload(),
            attachment=mark,
            congestion_control=zenoh.CongestionControl.BLOCK,
        )
        if not any(each.intersects(zenoh.KeyExpr(key)) for each in subscribed):
            continue
        if parse_data(key, TF_MESSAGE) is None:
            bad_keys += 1
            continue
        moving += topic == "tf"
        if mark is not None:
            try:
                attachment.decode(mark)
            except Exception:
                bad_attachments += 1
    deadline_s = time.monotonic() + 60
    while True:
        now = tf.stats()
        settled = (
            now["ros2_bad_keys"] - before["ros2_bad_keys"] >= bad_keys
            and now["ros2_bad_attachments"] - before["ros2_bad_attachments"] >= bad_attachments
            and sum(now[name] - before[name] for name in ("puts", "bad_puts")) >= moving
        )
        if settled:
            return moving, bad_attachments, bad_keys
        assert time.monotonic() < deadline_s, (now, moving, bad_attachments, bad_keys)
        time.sleep(0.05)
