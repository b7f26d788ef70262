"""The environment's choice of server, for the commands and the tf2 shim; the SDK ignores it."""

from __future__ import annotations

import os
from typing import Final

from .client import DEFAULT_ENDPOINT, DEFAULT_TREE

#: The server's endpoint, for example "tcp/robot:7447".
ENDPOINT_VARIABLE: Final = "ZENOH_TF_CONNECT"
#: The tree's name.
TREE_VARIABLE: Final = "ZENOH_TF_TREE"


def endpoint() -> str:
    """The endpoint to connect to if the user names none; an empty variable counts as unset."""
    return os.environ.get(ENDPOINT_VARIABLE) or DEFAULT_ENDPOINT


def tree() -> str:
    """The tree to ask for if the user names none; an empty variable counts as unset."""
    return os.environ.get(TREE_VARIABLE) or DEFAULT_TREE
