"""Keys and users of a server: its TLS files, who may connect, and the warning if anyone may."""

from __future__ import annotations

import argparse
import ipaddress
import ssl
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NoReturn

from zenoh_tf._net import credentials, zenoh_config
from zenoh_tf._net.credentials import NO_CREDENTIALS, Credentials
from zenoh_tf.errors import InvalidArgumentException
from zenoh_tf.text.flag_values import file_path

from . import access_control
from .access_rules import AccessRule


@dataclass(frozen=True, slots=True)
class Security:
    """Who may use a server."""

    tls_certificate: str | None = None
    tls_key: str | None = None
    tls_ca: str | None = None  # the authorities that sign clients' certificates
    users: str | None = None  # file of users and passwords
    rules: tuple[AccessRule, ...] = ()
    admin: bool = True
    credentials: Credentials = NO_CREDENTIALS  # of a server that joins a network

    @property
    def authenticates(self) -> bool:
        """True if a client must prove who it is."""
        return self.tls_ca is not None or self.users is not None

    @property
    def is_open(self) -> bool:
        """True if a client needs neither keys nor a user."""
        return self == Security(admin=self.admin)

    def router_settings(self, tree: str) -> dict[str, object]:
        """The settings of the embedded router that they stand for."""
        settings: dict[str, object] = {}
        if self.tls_certificate is not None:
            tls: dict[str, object] = {
                "listen_certificate": self.tls_certificate,
                "listen_private_key": self.tls_key,
                "close_link_on_expiration": True,
            }
            if self.tls_ca is not None:
                tls |= {"root_ca_certificate": self.tls_ca, "enable_mtls": True}
            settings["transport/link/tls"] = tls
        if self.users is not None:
            settings["transport/auth/usrpwd/dictionary_file"] = self.users
        if self.authenticates:
            settings["access_control"] = access_control.zenoh_settings(tree, self.rules)
        return settings


#: Anyone may connect and do everything.
OPEN = Security()


#: The flags with a value: its type, and what it is.
_FLAGS: Final[dict[str, tuple[Callable[[str], str], str]]] = {
    "--tls-certificate": (file_path, "certificate for endpoints tls/... and quic/..., PEM"),
    "--tls-key": (file_path, "its private key, PEM"),
    "--tls-ca": (
        file_path,
        "authorities that sign the certificates that clients must show, and those of servers "
        "that this one connects to, PEM",
    ),
    "--users": (file_path, "who may connect: a USER:PASSWORD a line, readable for its owner alone"),
    "--user": (str, "connect to other servers as this user"),
    "--password-file": (file_path, "file with that user's password"),
}


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this module."""
    group = parser.add_argument_group("keys and users (docs/how-to/security.md)")
    for name, (kind, meaning) in _FLAGS.items():
        metavar = "FILE" if kind is file_path else "NAME"
        group.add_argument(name, metavar=metavar, type=kind, help=meaning)
    group.add_argument(
        "--no-admin",
        action="store_true",
        help="nobody may clear or reset the tree, or remove frames",
    )


def from_flags(options: argparse.Namespace, rules: Sequence[AccessRule]) -> Security:
    """The security settings of these flags.

    Raises:
        InvalidArgumentException: They contradict each other, or a file is wrong.
    """
    if options.connect:
        return _joining(options, rules)
    follows = bool(options.mirror_of or options.replica_of)
    for name in ("user", "password_file"):
        if getattr(options, name) and not follows:
            _reject(name, "works with --connect only; --users says who may connect to this server")
    if options.tls_certificate is None:  # else the files are those of its own endpoints, too
        for endpoint in options.replica_of:
            zenoh_config.check_encrypted(endpoint, _credentials(options))
    # Without a certificate of the server, the authorities sign those of the others only.
    own_ca = options.tls_certificate is not None or not follows
    security = Security(
        options.tls_certificate,
        options.tls_key,
        options.tls_ca if own_ca else None,
        options.users,
        tuple(rules),
        not options.no_admin,
        _credentials(options) if follows else NO_CREDENTIALS,
    )
    _check(security, options.listen)
    return security


def _joining(options: argparse.Namespace, rules: Sequence[AccessRule]) -> Security:
    """Of a server that joins a network."""
    if options.users:
        _reject("users", "works with --listen only: the network's routers check their clients")
    if rules:
        _reject("access", "rules work with --listen only: configure the network's routers")
    given = _credentials(options)
    for endpoint in options.connect:
        zenoh_config.check_encrypted(endpoint, given)
    return Security(admin=not options.no_admin, credentials=given)


def _credentials(options: argparse.Namespace) -> Credentials:
    """What the server shows to others that it connects to."""
    return credentials.from_parts(
        options.tls_ca,
        options.tls_certificate,
        options.tls_key,
        options.user,
        password_file=options.password_file,
    )


def _check(security: Security, listen: Sequence[str]) -> None:
    if (security.tls_certificate is None) != (security.tls_key is None):
        missing = "tls_key" if security.tls_key is None else "tls_certificate"
        _reject(missing, "is missing: a certificate and its private key belong together")
    encrypted = [each for each in listen if _is_encrypted(each)]
    if security.tls_ca is not None and security.tls_certificate is None:
        _reject("tls_ca", "needs --tls-certificate and --tls-key as well")
    if security.tls_certificate is not None and not encrypted:
        _reject("listen", "has no endpoint for the certificate: add one such as tls/0.0.0.0:7447")
    if security.tls_certificate is None and any("#" not in each for each in encrypted):
        _reject("tls_certificate", "is missing: endpoints tls/... and quic/... need it")
    if security.tls_certificate is not None and security.tls_key is not None:
        _check_tls_files(security.tls_certificate, security.tls_key, security.tls_ca)
    if security.users is not None:
        check_users(security.users)
    if security.rules and not security.authenticates:
        _reject("access", "rules need to know the clients: set --users or --tls-ca")
    for rule in security.rules:
        if rule.users and security.users is None:
            _reject("users", "is missing, but an access rule names users")
        if rule.certificates and security.tls_ca is None:
            _reject("tls_ca", "is missing, but an access rule names certificates")


def _check_tls_files(certificate: str, key: str, ca: str | None) -> None:
    credentials.check_readable(certificate, "tls_certificate")
    credentials.check_private(key, "tls_key")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    credentials.load_certificate(context, certificate, key, "tls_")
    if ca is not None:
        credentials.check_readable(ca, "tls_ca")
        credentials.load_authorities(context, ca, "tls_")


def check_users(path: str) -> None:
    """Check a file of users: its mode and its lines.

    Raises:
        InvalidArgumentException: A line is wrong; the message names its number, not its text.
    """
    credentials.check_private(path, "users")
    try:
        lines = Path(path).read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError:
        _reject("users", f"file {path!r} is not text in UTF-8")
    seen: set[str] = set()
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        user, colon, password = line.partition(":")
        if not colon or not user or not password or line != line.strip():
            _reject("users", f"file {path!r}, line {number}: write USER:PASSWORD, without spaces")
        if user in seen:
            _reject("users", f"file {path!r}, line {number}: the user {user!r} is there twice")
        seen.add(user)
    if not seen:
        _reject("users", f"file {path!r} names no user, so nobody could connect")


def exposure(security: Security, listen: Sequence[str]) -> str | None:
    """A warning if anyone on the network can use the server or read what others send, else None."""
    public = [each for each in listen if not _is_local(each)]
    plain = [each for each in public if not _is_encrypted(each)]
    if security.users is not None:
        if not plain:
            return None
        return (
            f"{_shown(plain)} is not encrypted: anyone on the network can read and change what "
            "passes there, although --users asks for passwords. Listen on tls/... with "
            "--tls-certificate and --tls-key"
        )
    # A certificate is asked for on encrypted endpoints only.
    open_to_all = public if security.tls_ca is None else plain
    if not open_to_all:
        return None
    return (
        f"ANYONE WHO REACHES {_shown(open_to_all)} CAN READ, CHANGE AND CLEAR THE TREE: nobody has "
        "to prove who they are there. Set --users FILE, or --tls-certificate, --tls-key and "
        "--tls-ca (docs/how-to/security.md), or listen on 127.0.0.1 only"
    )


def _shown(endpoints: Sequence[str]) -> str:
    return ", ".join(map(zenoh_config.address, endpoints))


def _is_encrypted(endpoint: str) -> bool:
    return zenoh_config.protocol(endpoint) in zenoh_config.TLS_PROTOCOLS


def _is_local(endpoint: str) -> bool:
    """True if only this machine can reach an endpoint."""
    if zenoh_config.protocol(endpoint) == "unixsock-stream":
        return True
    host = zenoh_config.address(endpoint).partition("/")[2].rpartition(":")[0].strip("[]")
    try:
        return ipaddress.ip_address(host.partition("%")[0]).is_loopback
    except ValueError:
        return host == "localhost"


def _reject(flag: str, reason: str) -> NoReturn:
    name = flag if flag == "access" else "--" + flag.replace("_", "-")
    raise InvalidArgumentException(f"{name} {reason}", field=flag)
