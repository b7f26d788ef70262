"""The service against the real tf2's answers about a recorded run.

The recording is replayed into a running server by the command line; the questions are asked
from this process, in batches.
"""

import pytest

from tests.conftest import LendServer
from tests.support import command_line
from tests.support.recorded import RUN, Question, needs_recording, questions
from tests.support.runs import CONTROLS
from zenoh_tf import StampedTransform, TransformException
from zenoh_tf_client import Batch, Handle, TransformClient


def answer(handle: Handle[StampedTransform]) -> StampedTransform | TransformException:
    return handle.exception() or handle.result()


@needs_recording
@pytest.mark.parametrize("concurrency", CONTROLS)
def test_every_recorded_answer_agrees(lend_server: LendServer, concurrency: str) -> None:
    server = lend_server("--cache-time", "1000s", "--concurrency", concurrency)
    command_line.run("--connect", server.endpoint, "replay", str(RUN)).check_returncode()
    with TransformClient.connect(server.endpoint) as tf:
        assert len(questions()) > 1700
        for start in range(0, len(questions()), 250):
            asked = questions()[start : start + 250]
            with tf.batch() as batch:
                handles = [ask(batch, q) for q in asked]
            for question, handle in zip(asked, handles, strict=True):
                question.check(answer(handle))


def ask(batch: Batch, q: Question) -> Handle[StampedTransform]:
    if q.fixed_frame is None:
        return batch.lookup_transform(q.target, q.source, q.stamp_ns)
    return batch.lookup_transform_full(
        q.target, q.stamp_ns, q.source, q.source_stamp_ns, q.fixed_frame
    )
