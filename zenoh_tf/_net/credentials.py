"""What a client shows to a server, and what it checks of the server: TLS files, user, password.

A password is never part of a text that this module makes.
"""

from __future__ import annotations

import os
import stat
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ..errors import InvalidArgumentException

if TYPE_CHECKING:
    import ssl

#: The path of a file, as callers may give it.
FilePath = str | os.PathLike[str]

#: What the users of this machine must not be allowed to do with a file that holds a secret.
_OTHERS_MAY = stat.S_IRWXO | stat.S_IWGRP


@dataclass(frozen=True, slots=True)
class Credentials:
    """How a client proves who it is, and how it knows the server.

    Thread safety: immutable.

    Attributes:
        ca: File with the certificates of the authorities that sign servers' certificates, PEM.
            None for the public authorities that Zenoh brings along.
        certificate: File with the client's own certificate, PEM, for mutual TLS.
        key: File with the private key of `certificate`, PEM.
        user: Name of the user.
        password: Password of the user; neither shown nor logged.
    """

    ca: FilePath | None = None
    certificate: FilePath | None = None
    key: FilePath | None = None
    user: str | None = None
    password: str | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        """Check that the parts belong together and that the files can be read.

        Raises:
            InvalidArgumentException: A part is missing; `field` names it.
        """
        for one, other in (("certificate", "key"), ("user", "password")):
            for present, missing in ((one, other), (other, one)):
                if getattr(self, present) is not None and getattr(self, missing) is None:
                    raise InvalidArgumentException(
                        f"credentials have a {present} but no {missing}: give both",
                        field=missing,
                    )
        for name in ("ca", "certificate", "key"):
            path = getattr(self, name)
            if path is not None:
                check_readable(path, name)

    @property
    def uses_tls(self) -> bool:
        """Returns True if a part of it has a meaning for TLS endpoints only."""
        return self.ca is not None or self.certificate is not None


#: A client that shows nothing, and trusts public authorities only.
NO_CREDENTIALS = Credentials()


def zenoh_settings(credentials: Credentials) -> dict[str, object]:
    """The settings of a Zenoh configuration that credentials stand for."""
    settings: dict[str, object] = {}
    tls: dict[str, object] = {"verify_name_on_connect": True}
    if credentials.ca is not None:
        tls["root_ca_certificate"] = os.fspath(credentials.ca)
    if credentials.certificate is not None and credentials.key is not None:
        tls["enable_mtls"] = True
        tls["connect_certificate"] = os.fspath(credentials.certificate)
        tls["connect_private_key"] = os.fspath(credentials.key)
    settings["transport/link/tls"] = tls
    if credentials.user is not None:
        settings["transport/auth/usrpwd/user"] = credentials.user
        settings["transport/auth/usrpwd/password"] = credentials.password
    return settings


def check_readable(path: FilePath, field: str) -> None:
    """Check that a file can be read.

    Raises:
        InvalidArgumentException: It cannot; `field` is as given.
    """
    try:
        with open(path, "rb"):
            pass
    except OSError as error:
        raise InvalidArgumentException(
            f"cannot read the {field} file '{path}': {error.strerror}", field=field
        ) from error


def check_private(path: FilePath, field: str) -> None:
    """Check that a file can be read, and that no other user of this machine can read or change it.

    The file's group may read it, because containers get their secrets that way.

    Raises:
        InvalidArgumentException: It cannot, or others can; `field` is as given.
    """
    check_readable(path, field)
    mode = stat.S_IMODE(os.stat(path).st_mode)
    if mode & _OTHERS_MAY:
        raise InvalidArgumentException(
            f"the {field} file '{path}' has mode {mode:04o}, so that other users can read or "
            f"change it: run chmod 600 {path}",
            field=field,
        )


def read_password(path: FilePath) -> str:
    """The password in a file: its first line.

    Raises:
        InvalidArgumentException: The file cannot be read, or others can read it, or it is empty;
            `field` is "password_file".
    """
    check_private(path, "password_file")
    try:
        with open(path, encoding="utf-8") as file:
            text = file.read()
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidArgumentException(
            f"the password_file '{path}' is not text in UTF-8", field="password_file"
        ) from error
    password = text.partition("\n")[0].rstrip("\r")
    if not password:
        raise InvalidArgumentException(
            f"the password_file '{path}' has no password in its first line", field="password_file"
        )
    return password


def from_parts(
    ca: str | None = None,
    certificate: str | None = None,
    key: str | None = None,
    user: str | None = None,
    password: str | None = None,
    password_file: str | None = None,
) -> Credentials:
    """Credentials from what a command line or an environment names; empty texts count as unset.

    A password file counts more than a password.

    Raises:
        InvalidArgumentException: A part is missing or wrong; `field` names it.
    """
    if password_file:
        password = read_password(password_file)
    parts = (ca, certificate, key, user, password)
    if not any(parts):
        return NO_CREDENTIALS
    return Credentials(*(part or None for part in parts))


def load_certificate(
    context: ssl.SSLContext, certificate: FilePath, key: FilePath, prefix: str = ""
) -> None:
    """Load a certificate and its private key.

    Raises:
        InvalidArgumentException: They are no such files, or not a pair. `field` is "certificate" or
            "key" behind the prefix.
    """
    shown, shown_key = repr(os.fspath(certificate)), repr(os.fspath(key))
    try:
        # Without a password of its own, OpenSSL would ask for one on the terminal.
        context.load_cert_chain(certificate, key, password=lambda: b"")
    except (OSError, ValueError) as error:
        if getattr(error, "reason", None) == "KEY_VALUES_MISMATCH":
            raise InvalidArgumentException(
                f"the {prefix}key file {shown_key} is not the key of the certificate {shown}",
                field=f"{prefix}key",
            ) from error
        raise InvalidArgumentException(
            f"{shown} and its key {shown_key} are not a certificate and an unencrypted private "
            "key in PEM",
            field=f"{prefix}certificate",
        ) from error


def load_authorities(context: ssl.SSLContext, ca: FilePath, prefix: str = "") -> None:
    """Load the certificates of authorities.

    Raises:
        InvalidArgumentException: The file has none. `field` is "ca" behind the prefix.
    """
    try:
        context.load_verify_locations(ca)
    except OSError as error:
        raise InvalidArgumentException(
            f"the {prefix}ca file {os.fspath(ca)!r} has no certificates in PEM",
            field=f"{prefix}ca",
        ) from error
