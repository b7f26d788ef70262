"""A: what a set refuses."""

from __future__ import annotations

import pytest

from zenoh_tf import InvalidArgumentException

from .shorthand import Tree, put


def test_A01_no_insert_on_self_transform(tf: Tree) -> None:
    """A frame cannot be its own parent. [Q] Decision: a refusal raises, and names the frames."""
    with pytest.raises(InvalidArgumentException, match="same_frame"):
        put(tf, "same_frame", "same_frame", 10)
    assert tf.frames() == []
