"""``zenoh-tf urdf --joint-states``: follows a robot and says what is wrong, until interrupted."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from dataclasses import asdict
from typing import Final, NoReturn

from zenoh_tf.text import printable, quoted
from zenoh_tf_tools.urdf.joint_states import JointStateFeed
from zenoh_tf_tools.urdf.kinematics import JointTransforms

_PERIOD_S: Final = 0.5
#: After this long without a message it is reported.
_SILENCE_S: Final = 5.0


def listen(feed: JointStateFeed, joints: JointTransforms) -> NoReturn:
    """Wait for Ctrl-C, which raises KeyboardInterrupt. Meanwhile each kind of problem is one line
    on stderr, when it first occurs."""
    print(f"listening to {printable(feed.topic)}; Ctrl-C ends it", file=sys.stderr, flush=True)
    reported: set[str] = set()
    silent_at_s = time.monotonic() + _SILENCE_S
    while True:
        for kind, text in _problems(feed, joints, time.monotonic() > silent_at_s):
            if kind not in reported:
                reported.add(kind)
                print(f"zenoh-tf: {printable(text)}", file=sys.stderr, flush=True)
        time.sleep(_PERIOD_S)


def counts(feed: JointStateFeed, joints: JointTransforms) -> dict[str, int]:
    """What became of the messages and of the positions in them."""
    return asdict(feed.counts) | asdict(joints.counts)


def _problems(
    feed: JointStateFeed, joints: JointTransforms, is_late: bool
) -> Iterator[tuple[str, str]]:
    """(kind, text) of what is wrong by now."""
    found = counts(feed, joints)
    if not found["messages"] and feed.other_topic:
        yield "other", f"no message on {feed.topic}, but on {feed.other_topic}: name that topic"
    elif not found["messages"] and is_late:
        yield (
            "silence",
            f"no message on {feed.topic} so far: is the robot on the server's Zenoh network?",
        )
    for kind, text in (
        ("malformed", f"malformed messages are dropped: {feed.last_error}"),
        ("no_positions", "messages without positions are dropped"),
        ("no_stamp", "messages without a time (stamp 0) are dropped"),
        ("not_sent", f"messages are dropped: {feed.last_error}"),
        ("unknown_joints", "joints that the file has not are left out, such as"),
        ("not_numbers", "positions that are NaN or infinite are left out, such as that of"),
        (
            "beyond_limits",
            "positions beyond the limits are published all the same, such as that of",
        ),
    ):
        if found[kind]:
            first = joints.first.get(kind)
            yield kind, text if first is None else f"{text} {quoted(first)}"
