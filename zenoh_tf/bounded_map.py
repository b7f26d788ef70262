"""A map that holds a limited number of entries.

Thread safety: none; callers that set from several threads lock.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import TypeVar

_Key = TypeVar("_Key")
_Value = TypeVar("_Value")


class BoundedMap(OrderedDict[_Key, _Value]):
    """A dict of at most `most` entries: to set a further one removes the first.

    An entry that is set again becomes the last.
    """

    def __init__(self, most: int) -> None:
        super().__init__()
        self.most = most

    def __setitem__(self, key: _Key, value: _Value) -> None:
        super().__setitem__(key, value)
        self.move_to_end(key)
        if len(self) > self.most:
            self.popitem(last=False)
