"""The recorded robot run, and the real tf2's answers about it, if they are present."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from zenoh_tf import StampedTransform, Transform, TransformTree, errors

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
RUN = DATA / "nav2_turtlebot.mcap"
ANSWERS = DATA / "nav2_turtlebot.tf2-answers.json"

needs_recording = pytest.mark.skipif(
    not RUN.exists(), reason="the recorded run lies beside the project, not in it"
)


@cache
def transforms() -> list[tuple[bool, list[StampedTransform]]]:
    """Yield (is static, transforms) for each message, in log order."""
    from rosbags.highlevel import AnyReader  # noqa: PLC0415 - an extra

    messages = []
    with AnyReader([RUN]) as reader:
        chosen = [c for c in reader.connections if c.msgtype == "tf2_msgs/msg/TFMessage"]
        for connection, _, raw in reader.messages(connections=chosen):
            message: Any = reader.deserialize(raw, connection.msgtype)
            stampeds = []
            for t in message.transforms:
                x, q = t.transform.translation, t.transform.rotation
                stamp = t.header.stamp.sec * 10**9 + t.header.stamp.nanosec
                transform = Transform((x.x, x.y, x.z), (q.x, q.y, q.z, q.w))
                stampeds.append(
                    StampedTransform(t.header.frame_id, t.child_frame_id, stamp, transform)
                )
            messages.append((connection.topic == "/tf_static", stampeds))
    return messages


@dataclass(frozen=True)
class Question:
    """A lookup (with ``fixed_frame``: a full lookup), and tf2's answer."""

    target: str
    source: str
    stamp_ns: int | None
    fixed_frame: str | None
    source_stamp_ns: int | None
    error: str | None
    result_stamp_ns: int | None
    pose: tuple[float, ...] | None

    def ask(self, tree: TransformTree) -> StampedTransform | errors.TransformException:
        try:
            if self.fixed_frame is None:
                return tree.lookup_transform(self.target, self.source, self.stamp_ns)
            return tree.lookup_transform_full(
                self.target, self.stamp_ns, self.source, self.source_stamp_ns, self.fixed_frame
            )
        except errors.TransformException as error:
            return error

    def check(self, answer: StampedTransform | errors.TransformException) -> None:
        """Check for the same error class, or a transform within 1e-9 (rotations up to sign)."""
        if self.error is not None:
            assert isinstance(answer, getattr(errors, self.error)), (self, answer)
            return
        assert isinstance(answer, StampedTransform), (self, answer)
        assert answer.stamp_ns == self.result_stamp_ns, self
        assert self.pose is not None
        ours, theirs = np.array(answer.transform.pose()), np.array(self.pose)
        np.testing.assert_allclose(ours[:3], theirs[:3], atol=1e-9, err_msg=str(self))
        sign = 1.0 if ours[3:] @ theirs[3:] > 0 else -1.0
        np.testing.assert_allclose(sign * ours[3:], theirs[3:], atol=1e-9, err_msg=str(self))


@cache
def questions() -> list[Question]:
    """Return all questions except those that differ on purpose: an unknown frame in itself."""
    known = {s.parent_frame for _, ss in transforms() for s in ss}
    known |= {s.child_frame for _, ss in transforms() for s in ss}
    asked = json.loads(ANSWERS.read_text())

    def latest(stamp_ns: int) -> int | None:  # tf2's 0 means the latest, which is None here
        return stamp_ns or None

    def question(entry: dict[str, Any]) -> Question:
        has_pose = "translation" in entry
        return Question(
            entry["target"],
            entry["source"],
            latest(entry["target_stamp_ns" if "fixed" in entry else "stamp_ns"]),
            entry.get("fixed"),
            latest(entry["source_stamp_ns"]) if "fixed" in entry else None,
            entry.get("error"),
            entry.get("result_stamp_ns"),
            (*entry["translation"], *entry["rotation_xyzw"]) if has_pose else None,
        )

    everything = [question(e) for e in (*asked["lookups"], *asked["full_lookups"])]
    assert len(everything) == 1800
    return [q for q in everything if not (q.target == q.source and q.target not in known)]
