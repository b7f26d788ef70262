"""The checks of the tree's structure and names."""

from __future__ import annotations

from itertools import groupby
from typing import Final

from zenoh_tf.text import quoted
from zenoh_tf.text.similar import spelling
from zenoh_tf_tools.doctor.facts import TreeFacts
from zenoh_tf_tools.doctor.words import Evidence, listed

_DEEP: Final = 100


def unconnected(facts: TreeFacts) -> Evidence:
    sizes = sorted(((len(names), root) for root, names in facts.roots.items()), reverse=True)
    if len(sizes) < 2:
        return
    for size, root in sizes[1:]:
        yield (
            root,
            f"this root's tree of {size:,} frames is not connected to the largest one, whose root "
            f"is {quoted(sizes[0][1])}",
        )


def alike_names(facts: TreeFacts) -> Evidence:
    for _, group in groupby(sorted(facts.frames, key=spelling), key=spelling):
        names = sorted(group)
        if len(names) > 1:
            yield names[0], f"these frames differ by slashes or case only: {listed(names)}"


def deep(facts: TreeFacts) -> Evidence:
    deepest = max(facts.frames, key=facts.depth, default=None)
    if deepest is not None and facts.depth(deepest) > _DEEP:
        yield deepest, f"{facts.depth(deepest):,} links lie between it and its root"
