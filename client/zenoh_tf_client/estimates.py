"""The estimates of `TransformClient`: poses with their errors."""

# Made by scripts/sync_client.py from client/zenoh_tf_client/aio/estimates.py: edit that.

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from numpy.typing import ArrayLike

from zenoh_tf import Estimate, EstimateArray
from zenoh_tf.shared_tree import AskServer, SharedTree

from .requests import estimates
from .session.shared_reads import SharedReads


class Estimates:
    """A base of `TransformClient`, which says how to read.

    Each method reads the server's memory where it is mapped. Else, or if that has no answer, it
    asks the server.
    """

    _reads: SharedReads
    _tree: SharedTree

    def estimate_transform(
        self,
        target: str,
        source: str,
        stamp_ns: int | None = None,
        *,
        level: float = 0.9,
        max_by_s: float = 0.5,
        max_error_m: float | None = None,
        max_error_rad: float | None = None,
        min_level: float | None = None,
        radius_m: float = 0.0,
    ) -> Estimate:
        """As `TransformTree.estimate_transform`; now is by the server's clock.

        Raises:
            ServiceException: As for every call; see the class.

        Example:
            ``X = tf.estimate_transform("map", "base", max_error_m=0.02).transform``
        """
        terms: dict[str, Any] = {
            **{"level": level, "max_by_s": max_by_s, "radius_m": radius_m},
            **{"max_error_m": max_error_m, "max_error_rad": max_error_rad, "min_level": min_level},
        }
        found = self._tree.estimate_transform(target, source, stamp_ns, **terms)
        if type(found) is not AskServer:
            return found
        return self._reads.ask(
            found, estimates.estimate_transform(target, source, stamp_ns, **terms)
        )

    def estimate_transforms(
        self,
        targets: str | Sequence[str],
        sources: str | Sequence[str],
        stamps_ns: ArrayLike | None,
        *,
        level: float = 0.9,
        max_by_s: float = 0.5,
        radius_m: float = 0.0,
    ) -> EstimateArray:
        """As `TransformTree.estimate_transforms`, in one request; now is by the server's clock.

        Raises:
            ServiceException: As for every call; see the class.

        Example:
            ``near = tf.estimate_transforms("map", arms, None).error_m < 0.02``
        """
        found = self._tree.estimate_transforms(
            targets, sources, stamps_ns, level=level, max_by_s=max_by_s, radius_m=radius_m
        )
        if type(found) is not AskServer:
            return found
        request = estimates.estimate_transforms(
            targets, sources, stamps_ns, level=level, max_by_s=max_by_s, radius_m=radius_m
        )
        return self._reads.ask(found, request)
