"""The part of the native module `_core` that reads trees of other processes."""

import enum
from typing import Literal, final

from zenoh_tf._core import Tree
from zenoh_tf._core_stubs.reads import Reads

LAYOUT: tuple[int, int]  # version and hash of the layout that this build writes and reads

class RegionRefused(ValueError): ...

class LeaseKeeper:
    # Holds a shared tree's lease from a thread of its own, which Python cannot delay. Only for an
    # owner whose tree no other process can take over while this one lives, however long it stops.
    def __init__(self, tree: Tree) -> None: ...
    def end(self) -> None: ...

@final
class AskServer(enum.Enum):
    def __bool__(self) -> Literal[False]: ...  # zenoh_tf.shared_tree

    BUSY = ...
    LAPSED = ...
    WAITING = ...
    UNREADABLE = ...
    ABSENT = ...

# AskServer.ABSENT, whatever the arguments.
def ask_absent(*arguments: object, **named: object) -> AskServer: ...

class SharedTree(Reads[AskServer]):
    # A tree of another process; see zenoh_tf.shared_tree.
    def __init__(self, fd: int) -> None: ...  # does not keep it; RegionRefused says why not
    @property
    def instance(self) -> str: ...
    @property
    def lease_left_s(self) -> float: ...
