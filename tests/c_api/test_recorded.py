"""The C++ header against the real tf2's answers about a recorded run."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.conftest import StartServer
from tests.support import command_line
from tests.support.recorded import RUN, Question, needs_recording, questions, transforms
from zenoh_tf import StampedTransform, Transform, errors

from .readers import Reader

pytestmark = [
    needs_recording,
    pytest.mark.skipif(sys.platform != "linux", reason="needs memfd"),
]

EXCEPTIONS: dict[str, type[errors.TransformException]] = {
    "ZTF_LOOKUP": errors.LookupException,
    "ZTF_CONNECTIVITY": errors.ConnectivityException,
    "ZTF_INVALID_ARGUMENT": errors.InvalidArgumentException,
    "ZTF_NO_DATA": errors.NoDataForExtrapolationException,
    "ZTF_BACKWARD": errors.BackwardExtrapolationException,
    "ZTF_FORWARD": errors.ForwardExtrapolationException,
}


def shown(stamp_ns: int | None) -> int | str:
    return "-" if stamp_ns is None else stamp_ns


def answer(reader: Reader, q: Question) -> StampedTransform | errors.TransformException:
    if q.fixed_frame is None:
        code, words = reader.ask("lookup", q.target, q.source, shown(q.stamp_ns), 0)
    else:
        stamps = shown(q.stamp_ns), shown(q.source_stamp_ns)
        code, words = reader.ask("full", q.target, stamps[0], q.source, stamps[1], q.fixed_frame)
    if code != "ok":
        return EXCEPTIONS[code](" ".join(words))
    x, y, z, *rotation = map(float, words[1:])
    pose = Transform((x, y, z), rotation)
    return StampedTransform(q.target, q.source, int(words[0]), pose)


def check_all(reader: Reader) -> None:
    assert len(questions()) > 1700
    for question in questions():
        question.check(answer(reader, question))


def test_of_a_tree_of_the_process() -> None:
    with Reader() as reader:
        reader.do("create", 1_000_000)
        for is_static, stampeds in transforms():
            for s in stampeds:
                names = s.parent_frame, s.child_frame
                reader.do("set", *names, s.stamp_ns, int(is_static), *s.transform.pose())
        check_all(reader)


def test_of_a_servers_tree(start_sharing: StartServer, socket_folder: Path) -> None:
    server = start_sharing("--cache-time", "1000s")
    command_line.run("--connect", server.endpoint, "replay", str(RUN)).check_returncode()
    with Reader() as reader:
        reader.do("open", server.tree, socket_folder, 0)
        check_all(reader)
