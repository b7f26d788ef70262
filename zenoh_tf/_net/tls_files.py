"""Loading TLS files, with errors that name the file. Server and client check theirs with it."""

from __future__ import annotations

import os
import ssl

from ..errors import InvalidArgumentException
from .credentials import FilePath


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
    except (ssl.SSLError, OSError, ValueError) as error:
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
    except (ssl.SSLError, OSError) as error:
        raise InvalidArgumentException(
            f"the {prefix}ca file {os.fspath(ca)!r} has no certificates in PEM",
            field=f"{prefix}ca",
        ) from error
