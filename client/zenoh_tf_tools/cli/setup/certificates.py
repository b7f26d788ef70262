"""``zenoh-tf certificates``: makes an authority and certificates to try TLS with."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

from zenoh_tf.text.flag_values import number
from zenoh_tf_tools.cli import output
from zenoh_tf_tools.cli.types import Commands, examples

_DEFAULT_DAYS = 365.0
_MAX_DAYS = 36_500.0


def add(commands: Commands, common: argparse.ArgumentParser) -> None:
    certificates = commands.add_parser(
        "certificates",
        parents=[common],
        help="make an authority, a server's and clients' certificates for a trial",
        description="Make a certificate authority, a server's certificate and clients' "
        "certificates in a folder, and print how to use them. A folder that has an authority "
        "already gets further certificates from it. Needs no server, but the library "
        "cryptography: pip install 'zenoh-tf[security]'. Keep ca-key.pem secret: its owner can "
        "make certificates for anyone.",
        **examples(
            "zenoh-tf certificates keys --host robot.local 10.0.0.5 --client arm camera",
            "zenoh-tf certificates keys --client planner --days 30",
        ),
    )
    certificates.add_argument("folder", metavar="DIR", type=Path)
    certificates.add_argument(
        "--host",
        metavar="NAME",
        nargs="+",
        default=[],
        help="the host names and addresses under which clients reach the server; none: make "
        "clients' certificates only",
    )
    certificates.add_argument(
        "--client",
        metavar="NAME",
        nargs="+",
        default=[],
        help="the clients' names, which access rules know them by (certificates = [NAME])",
    )
    certificates.add_argument(
        "--days",
        type=number(0.0, _MAX_DAYS, above=True),
        default=_DEFAULT_DAYS,
        metavar="N",
        help=f"how long they are valid (default {_DEFAULT_DAYS:g})",
    )
    certificates.set_defaults(run=_certificates)


def _certificates(args: argparse.Namespace) -> int:
    # Imported here: the library that it needs is an extra.
    from zenoh_tf_tools.cli.setup import certificate_files as files  # noqa: PLC0415

    folder: Path = args.folder
    period = files.period_of(args.days)
    authority = files.Authority(folder, period)
    if args.host:
        authority.issue("server", args.host, period)
    for name in args.client:
        authority.issue(name, [], period)
    ca = files.authority_file(folder)
    made = [*(["server"] if args.host else []), *args.client]
    if args.json:
        output.print_json(
            {
                "ca": str(ca),
                "certificates": {
                    name: {
                        "certificate": str(files.certificate_file(folder, name)),
                        "key": str(files.key_file(folder, name)),
                    }
                    for name in made
                },
            }
        )
        return 0
    print(f"made {', '.join(made) or 'no certificate'} in {folder}, signed by {ca}")
    for name in made:
        flags = _flags(files.certificate_file(folder, name), files.key_file(folder, name), ca)
        if name == "server":
            print(f"\nserver:\n  zenoh-tf-server --listen tls/0.0.0.0:7447 {flags}")
        else:
            host = args.host[0] if args.host else "HOST"
            command = f"zenoh-tf --connect tls/{_bracketed(host)}:7447 {flags} frames"
            print(f"\nclient {name}:\n  {command}")
    return 0


def _flags(certificate: Path, key: Path, ca: Path) -> str:
    names = ("--tls-certificate", "--tls-key", "--tls-ca")
    paths = (certificate, key, ca)
    return " ".join(
        f"{name} {shlex.quote(str(path))}" for name, path in zip(names, paths, strict=True)
    )


def _bracketed(host: str) -> str:
    return f"[{host}]" if ":" in host else host
