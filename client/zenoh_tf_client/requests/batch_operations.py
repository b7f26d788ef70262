"""The operations that a `Batch` records, one method for each."""

from __future__ import annotations

import functools
import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Concatenate, Final, ParamSpec, TypeVar

from . import estimates, info, lookups, writes
from .handle import Handle
from .request import Request

P = ParamSpec("P")
T = TypeVar("T")

_SELF: Final = inspect.Parameter("self", inspect.Parameter.POSITIONAL_ONLY)


def _recorded(
    make: Callable[P, Request[T]],
) -> Callable[Concatenate[BatchOperations, P], Handle[T]]:
    """The method that records the request which `make` makes of its arguments."""

    @functools.wraps(make)
    def record(batch: BatchOperations, /, *arguments: P.args, **named: P.kwargs) -> Handle[T]:
        return batch._record(make(*arguments, **named))

    record.__doc__ = f"As `TransformClient.{make.__name__}`."
    found = inspect.signature(make)  # which `wraps` shows as that of a method, without `self`
    record.__signature__ = found.replace(  # type: ignore[attr-defined]
        parameters=[_SELF, *found.parameters.values()], return_annotation=Handle
    )
    return record


class BatchOperations(ABC):
    """The base of both batches. Each method records that of `TransformClient` with its name.

    It takes the same arguments. The handle's `result()` returns what that method returns, and
    raises what it raises.
    """

    @abstractmethod
    def _record(self, request: Request[T]) -> Handle[T]:
        """Add a request to what the batch sends."""

    lookup_transform = _recorded(lookups.lookup_transform)
    lookup_transform_full = _recorded(lookups.lookup_transform_full)
    can_transform = _recorded(lookups.can_transform)
    lookup_latest_transform = _recorded(lookups.lookup_latest_transform)
    lookup_latest_transform_xact = _recorded(lookups.lookup_latest_transform_xact)
    lookup_latest_transforms_xact = _recorded(lookups.lookup_latest_transforms_xact)
    lookup_transforms = _recorded(lookups.lookup_transforms)
    sample = _recorded(lookups.sample)
    latest_common_time = _recorded(lookups.latest_common_time)
    lookup_velocity = _recorded(lookups.lookup_velocity)
    estimate_transform = _recorded(estimates.estimate_transform)
    estimate_transforms = _recorded(estimates.estimate_transforms)
    set_transform = _recorded(writes.set_transform)
    set_transforms_xact = _recorded(writes.set_transforms_xact)
    frames = _recorded(info.frames)
    frame = _recorded(info.frame)
    authorities = _recorded(info.authorities)
    parent = _recorded(info.parent)
    chain = _recorded(info.chain)
    stats = _recorded(info.stats)
