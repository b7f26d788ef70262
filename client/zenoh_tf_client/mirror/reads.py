"""The lookups of mirrors that never wait: those of the embedded tree.

While there is a copy, the methods here are not called: the mirror has the tree's own methods as
attributes, because a call of Python's in between would cost half as much as a lookup.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING, Any, Final

from zenoh_tf import Estimate
from zenoh_tf.estimate import TreeEstimates

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
    "explain",
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

    @abstractmethod
    def _now_ns(self) -> int:
        """The time by the server's real-time clock, as far as it is known here."""

    estimate_transform = TreeEstimates.estimate_transform
    estimate_transforms = TreeEstimates.estimate_transforms

    def _estimate(self, *arguments: Any) -> Estimate:
        return self._tree._estimate(*arguments)

    def _estimate_columns(self, *arguments: Any) -> EstimateColumns:
        return self._tree._estimate_columns(*arguments)
