"""The lookups of mirrors that never wait: those of the embedded tree.

While there is a copy, the methods here are not called: the mirror has the tree's own methods as
attributes, because a call of Python's in between would cost half as much as a lookup.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

from zenoh_tf import Estimate, Explanation
from zenoh_tf.estimate import TreeEstimates
from zenoh_tf.text.times import age

from .tree_reads import TreeReads

if TYPE_CHECKING:
    from zenoh_tf._core_stubs.estimates import EstimateColumns

#: Those that never wait.
PLAIN: Final = (
    "latest_common_time",
    "lookup_transforms",
    "sample",
    "deskew",
    "lookup_velocity",
    "frames",
    "frame",
    "parent",
    "chain",
    "_estimate",
    "_estimate_columns",
)

#: Those that have a time-out. A mirror that may block its caller has them as attributes as well.
WAITING: Final = ("lookup_transform", "lookup_transform_full", "can_transform")

#: Those that may ask the server instead.
LATEST: Final = (
    "lookup_latest_transform",
    "lookup_latest_transform_xact",
    "lookup_latest_transforms_xact",
)


class MirrorReads(TreeReads):
    """A base of `BaseMirror`, which has the tree."""

    #: A mirror that is older does not hear its server.
    _silent_s: float

    @abstractmethod
    def _now_ns(self) -> int:
        """The time by the server's real-time clock, as far as it is known here."""

    @property
    @abstractmethod
    def age_s(self) -> float:
        """How old what is read may be, in seconds."""

    def explain(self, target: str, source: str, stamp_ns: int | None = None) -> Explanation:
        """As `TransformTree.explain`, also if the mirror does not hear its server."""
        found, age_s = self._tree.explain(target, source, stamp_ns), self.age_s
        if age_s < self._silent_s:
            return found
        return replace(
            found,
            reasons=(
                *found.reasons,
                f"The mirror is disconnected from its server for {age(round(age_s * 1e9))}, and "
                "its last poses are read.",
            ),
            advice=(*found.advice, "Check that the server runs, and the network to it."),
        )

    estimate_transform = TreeEstimates.estimate_transform
    estimate_transforms = TreeEstimates.estimate_transforms

    def _estimate(self, *arguments: Any) -> Estimate:
        return self._tree._estimate(*arguments)

    def _estimate_columns(self, *arguments: Any) -> EstimateColumns:
        return self._tree._estimate_columns(*arguments)
