"""The embedded tree against the real tf2's answers about a recorded run."""

from typing import Literal

import pytest

from tests.support.concurrency import CONTROLS
from tests.support.recorded import needs_recording, questions, transforms
from zenoh_tf import TransformTree


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
        question.check(question.ask(tree))
