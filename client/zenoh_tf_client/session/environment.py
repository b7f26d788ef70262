"""The environment's choice of server and credentials, for the commands and the tf2 shim; the SDK
ignores it."""

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
#: The file with the certificates of the authorities that sign servers' certificates.
CA_VARIABLE: Final = "ZENOH_TF_CA"
#: The files with this client's certificate and its private key.
CERTIFICATE_VARIABLE: Final = "ZENOH_TF_CERTIFICATE"
KEY_VARIABLE: Final = "ZENOH_TF_KEY"
#: The user, and the password or a file that has it.
USER_VARIABLE: Final = "ZENOH_TF_USER"
PASSWORD_VARIABLE: Final = "ZENOH_TF_PASSWORD"
PASSWORD_FILE_VARIABLE: Final = "ZENOH_TF_PASSWORD_FILE"
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


def client_credentials(
    *,
    ca: str | None = None,
    certificate: str | None = None,
    key: str | None = None,
    user: str | None = None,
    password_file: str | None = None,
) -> Credentials:
    """The credentials to connect with; an argument counts more than its variable.

    Raises:
        InvalidArgumentException: A part is missing or wrong; `field` names it.
    """
    return credentials.from_parts(
        ca or os.environ.get(CA_VARIABLE),
        certificate or os.environ.get(CERTIFICATE_VARIABLE),
        key or os.environ.get(KEY_VARIABLE),
        user or os.environ.get(USER_VARIABLE),
        os.environ.get(PASSWORD_VARIABLE),
        password_file or os.environ.get(PASSWORD_FILE_VARIABLE),
    )
