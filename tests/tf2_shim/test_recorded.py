"""A buffer with a tree of its own gives the real tf2's answers about a recorded run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pytest

from tests.support.recorded import RUN, needs_recording, questions, transforms
from zenoh_tf import StampedTransform
from zenoh_tf.tf2 import Buffer, Duration, Time
from zenoh_tf.tf2.messages import message_of, stamped_of


@dataclass
class AsTree:
    """Lookups of a buffer, with the arguments and results of a tree."""

    buffer: Buffer

    def lookup_transform(self, target: str, source: str, stamp_ns: int | None) -> StampedTransform:
        return stamped_of(self.buffer.lookup_transform(target, source, _time(stamp_ns)))

    def lookup_transform_full(
        self,
        target: str,
        target_ns: int | None,
        source: str,
        source_ns: int | None,
        fixed_frame: str,
    ) -> StampedTransform:
        return stamped_of(
            self.buffer.lookup_transform_full(
                target, _time(target_ns), source, _time(source_ns), fixed_frame
            )
        )


def _time(stamp_ns: int | None) -> Time:
    return Time(nanoseconds=stamp_ns or 0)


def by_messages() -> Buffer:
    buffer = Buffer(Duration(seconds=1000))
    for static, stampeds in transforms():
        for stamped in stampeds:
            store = buffer.set_transform_static if static else buffer.set_transform
            store(message_of(stamped), "default_authority")
    return buffer


@needs_recording
@pytest.mark.parametrize("make", [by_messages, lambda: Buffer.from_recording(RUN)])
def test_every_recorded_answer_agrees(make: Any) -> None:
    tree: Any = AsTree(make())
    assert len(questions()) > 1700
    for question in questions():
        question.check(question.ask(tree))
