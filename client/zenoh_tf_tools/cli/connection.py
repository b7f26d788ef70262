"""Opens the connection that every command uses."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from zenoh_tf_client import TransformClient
from zenoh_tf_client.session import environment
from zenoh_tf_client.session.mapped_tree import Mode

#: The options of `add_credentials`: the name of the credential, and what its help says.
_CREDENTIALS: Final = (
    ("ca", "--tls-ca", "FILE", "authorities that sign certificates"),
    ("certificate", "--tls-certificate", "FILE", "the client's certificate"),
    ("key", "--tls-key", "FILE", "the certificate's private key"),
    ("user", "--user", "NAME", "the user to connect as"),
    ("password_file", "--password-file", "FILE", "file whose first line is the password"),
)


@contextmanager
def connect(args: argparse.Namespace, reads: Mode | None = None) -> Iterator[TransformClient]:
    """A client for the tree that the options name, closed at the end.

    `reads`: how it reads; None for what the environment says.

    Raises what ``TransformClient.connect`` raises.
    """
    if getattr(args, "file", None) is None and (
        getattr(args, "topics", None) or getattr(args, "prefixes", None)
    ):
        args.usage_error("--topic and --prefix choose from a recording: give its FILE")
    credentials = environment.client_credentials(
        **{name: getattr(args, name) for name, *_ in _CREDENTIALS}
    )
    with TransformClient.connect(
        args.connect,
        tree=args.tree,
        timeout_s=args.timeout,
        credentials=credentials,
        reads=reads,
    ) as tf:
        yield tf


def add_credentials(
    parser: argparse.ArgumentParser, default: object = None, *, shown: bool = True
) -> None:
    """Add the options that say who the user is. There is none for the password itself, because
    every user of the machine can see the arguments of a process.

    `shown`: in the help text.
    """
    group = parser.add_argument_group("keys and users")
    for name, option, metavar, meaning in _CREDENTIALS:
        text = f"{meaning} (default: the environment's {environment.CREDENTIALS[name]})"
        group.add_argument(
            option,
            dest=name,
            metavar=metavar,
            default=default,
            help=text if shown else argparse.SUPPRESS,
        )
