"""Opens the connection that every command uses."""

from __future__ import annotations

import argparse

from zenoh_tf_client import TransformClient, environment
from zenoh_tf_client.shared_reads import Mode


def connect(args: argparse.Namespace, reads: Mode | None = None) -> TransformClient:
    """Return a client for the tree that the options name; a context manager.

    `reads`: how it reads; None for what the environment says.

    Raises what ``TransformClient.connect`` raises.
    """
    credentials = environment.client_credentials(
        ca=args.tls_ca,
        certificate=args.tls_certificate,
        key=args.tls_key,
        user=args.user,
        password_file=args.password_file,
    )
    return TransformClient.connect(
        args.connect,
        tree=args.tree,
        timeout_s=args.timeout,
        credentials=credentials,
        reads=reads or environment.reads(),
    )


def add_credentials(parser: argparse.ArgumentParser, default: object = None) -> None:
    """Add the options that say who the user is. There is none for the password itself, because
    every user of the machine can see the arguments of a process."""
    group = parser.add_argument_group("keys and users")
    for option, metavar, variable, meaning in (
        (
            "--tls-ca",
            "FILE",
            environment.CA_VARIABLE,
            "authorities that sign certificates",
        ),
        ("--tls-certificate", "FILE", environment.CERTIFICATE_VARIABLE, "the client's certificate"),
        ("--tls-key", "FILE", environment.KEY_VARIABLE, "the certificate's private key"),
        ("--user", "NAME", environment.USER_VARIABLE, "the user to connect as"),
        (
            "--password-file",
            "FILE",
            environment.PASSWORD_FILE_VARIABLE,
            "file with the user's password in its first line",
        ),
    ):
        group.add_argument(
            option,
            metavar=metavar,
            default=default,
            help=f"{meaning} (default: the environment's {variable})",
        )
