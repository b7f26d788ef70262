"""The embedded tree against the real tf2's answers about a recorded run."""

from typing import Literal

import pytest

from tests.support.concurrency import CONTROLS
from tests.support.recorded import Question, needs_recording, questions, transforms
from zenoh_tf import StampedTransform, TransformException, TransformTree


def ask(tree: TransformTree, q: Question) -> StampedTransform | TransformException:
    try:
        if q.fixed_frame is None:
            return tree.lookup_transform(q.target, q.source, q.stamp_ns)
        return tree.lookup_transform_full(
            q.target, q.stamp_ns, q.source, q.source_stamp_ns, q.fixed_frame
        )
    except TransformException as error:
        return error


@needs_recording
@pytest.mark.parametrize("concurrency", CONTROLS)
def test_every_recorded_answer_agrees(
    concurrency: Literal["optimistic", "2pl", "giant"],
) -> None:
    tree = TransformTree(cache_time_s=1000.0, concurrency=concurrency)
    for static, stampeds in transforms():
        for stamped in stampeds:
            tree.set_transform(stamped, static=static)
    assert len(questions()) > 1700
    for question in questions():
        question.check(ask(tree, question))
