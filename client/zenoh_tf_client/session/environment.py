"""The environment's choice of server and credentials, for the SDK, the commands and the tf2
shim."""

from __future__ import annotations

import os
from typing import Final, cast

from zenoh_tf._net import credentials
from zenoh_tf._net.credentials import Credentials

from .connection import DEFAULT_ENDPOINT, DEFAULT_TREE
from .mapped_tree import Mode

#: The server's endpoint, for example "tcp/robot:7447", or several with commas between.
ENDPOINT_VARIABLE: Final = "ZENOH_TF_CONNECT"
#: The tree's name.
TREE_VARIABLE: Final = "ZENOH_TF_TREE"
#: The parts of `credentials.from_parts`: files with the certificates of the authorities that sign
#: servers' certificates, with this client's certificate and its private key; the user, and the
#: password or a file that has it.
CREDENTIALS: Final = {
    "ca": "ZENOH_TF_CA",
    "certificate": "ZENOH_TF_CERTIFICATE",
    "key": "ZENOH_TF_KEY",
    "user": "ZENOH_TF_USER",
    "password": "ZENOH_TF_PASSWORD",
    "password_file": "ZENOH_TF_PASSWORD_FILE",
}
#: How lookups are answered: "shared" or "query"; see `TransformClient.connect`.
READS_VARIABLE: Final = "ZENOH_TF_READS"


def endpoint() -> str:
    """Where to connect if the user names nothing; an empty variable counts as unset."""
    return os.environ.get(ENDPOINT_VARIABLE) or DEFAULT_ENDPOINT


def tree() -> str:
    """The tree to ask for if the user names none; an empty variable counts as unset."""
    return os.environ.get(TREE_VARIABLE) or DEFAULT_TREE


def reads() -> Mode:
    """How to read; an empty variable counts as unset. `TransformClient.connect` checks it."""
    return cast(Mode, os.environ.get(READS_VARIABLE) or "shared")


def client_credentials(**parts: str | None) -> Credentials:
    """The credentials to connect with; an argument, named as in `CREDENTIALS`, counts more than its
    variable.

    Raises:
        InvalidArgumentException: A part is missing or wrong; `field` names it.
    """
    found = {name: parts.get(name) or os.environ.get(each) for name, each in CREDENTIALS.items()}
    return credentials.from_parts(**found)
