"""Why a connection failed: a short look at the port finds out whether something listens, speaks
TLS, and can be trusted.

Zenoh's error is the same for all of these: `zenoh.open` raises a ZError "Unable to connect to any
of [...]", whatever the other end has said (the close message's reason is only logged, as in
eclipse-zenoh/zenoh#2577).
"""

from __future__ import annotations

import contextlib
import os
import socket
import ssl
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Final

from .._net import zenoh_config
from .._net.credentials import Credentials, load_authorities, load_certificate
from ..errors import AccessDenied, InvalidArgumentException, ServerUnavailable
from ..errors import TransformException as Failure
from ..text import quoted

_TIMEOUT_S: Final = 2.0
#: How long a server may take to refuse a client's certificate after the handshake.
_REFUSAL_S: Final = 0.3
#: The field of the error if the server does not let the user in.
_USER: Final = "user"

#: The length of a message without bytes, to which Zenoh answers with the end of the connection.
_EMPTY_MESSAGE: Final = b"\0\0"

#: OpenSSL's numbers of reasons why a certificate is not trusted.
_EXPIRED: Final = 10
_NOT_YET_VALID: Final = 9
_UNKNOWN_AUTHORITY: Final = (2, 18, 19, 20, 21)
_WRONG_NAME: Final = (62, 64)


def explain_all(
    endpoints: Sequence[str], tree: str, timeout_s: float, credentials: Credentials
) -> Failure:
    """The error for a list of endpoints of which none could be connected to: as `explain` for each.

    It is AccessDenied if that is so for all of them.
    """
    if len(endpoints) == 1:
        return explain(endpoints[0], tree, timeout_s, credentials)
    with ThreadPoolExecutor(len(endpoints)) as pool:
        failures = list(
            pool.map(lambda each: explain(each, tree, timeout_s, credentials), endpoints)
        )
    for failure in failures:
        if isinstance(failure, InvalidArgumentException):  # of the credentials
            return failure
    text = f"none of {len(endpoints)} endpoints can be reached: {'; '.join(map(str, failures))}"
    if all(isinstance(failure, AccessDenied) for failure in failures):
        return AccessDenied(text, field=failures[0].field)
    return ServerUnavailable(text)


def explain(endpoint: str, tree: str, timeout_s: float, credentials: Credentials) -> Failure:
    """The error for an endpoint that Zenoh could not connect to within `timeout_s`.

    It is AccessDenied if the server there does not let this client in, or cannot be trusted. Takes
    a few round trips; where nobody answers, at most as long as the attempt, and two seconds.
    """
    where = zenoh_config.address(endpoint)
    protocol, _, address = where.partition("/")
    unknown = ServerUnavailable(
        f"nothing listens at {where} (tree {tree!r}, tried for {timeout_s:g} s)"
    )
    if protocol not in ("tcp", "tls"):
        return unknown
    host, _, port = address.rpartition(":")
    target = (host.strip("[]"), int(port))
    try:
        connection = _connect(target, timeout_s)
    except socket.gaierror as error:
        return ServerUnavailable(
            f"the host {quoted(target[0])} of {where} is not known: {error.strerror}"
        )
    except OSError:
        return unknown
    # Without TLS first: a server that expects TLS refuses that at once, but a Zenoh server takes
    # the first bytes of TLS for the length of a message, and waits for the rest of it.
    with connection:
        try:
            is_zenoh = _is_zenoh(connection)
        except TimeoutError:
            return ServerUnavailable(
                f"{where} accepts connections, but answers nothing within {_TIMEOUT_S:g} s: the "
                "server is stopped or overloaded, or is no zenoh-tf-server"
            )
        except OSError:
            is_zenoh = False
    if is_zenoh:
        return _no_tls(where) if protocol == "tls" else _refused(where, credentials)
    try:
        with _connect(target, timeout_s) as connection:
            if protocol == "tls":
                return _explain_tls(connection, target[0], where, endpoint, credentials)
            if _speaks_tls(connection):
                secure = where.replace("tcp/", "tls/", 1)
                return ServerUnavailable(
                    f"{where} speaks TLS: connect to {secure}, with the server's ca"
                )
            return _not_zenoh(where)
    except OSError:
        return ServerUnavailable(
            f"{where} accepts connections and then ends them; is a zenoh-tf-server there?"
        )


def _connect(target: tuple[str, int], timeout_s: float) -> socket.socket:
    connection = socket.create_connection(target, min(timeout_s, _TIMEOUT_S))
    connection.settimeout(_TIMEOUT_S)
    return connection


def _explain_tls(
    connection: socket.socket, host: str, where: str, endpoint: str, credentials: Credentials
) -> Failure:
    try:
        context = _context(credentials)
    except InvalidArgumentException as error:
        return error
    if "#" in endpoint:  # it may name TLS files of its own
        context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    try:
        with context.wrap_socket(connection, server_hostname=host) as secure:
            return _explain_secure_session(secure, where, credentials)
    except ssl.SSLCertVerificationError as error:
        return _untrusted(error, host, where, credentials)
    except ssl.SSLError as error:
        if error.reason in ("WRONG_VERSION_NUMBER", "UNEXPECTED_EOF_WHILE_READING"):
            return _no_tls(where)
        return _refused_certificate(error, where, credentials)


def _no_tls(where: str) -> Failure:
    plain = where.replace("tls/", "tcp/", 1)
    return ServerUnavailable(
        f"{where} does not speak TLS: connect to {plain}, or start the server with "
        "--tls-certificate and --tls-key"
    )


def _context(credentials: Credentials) -> ssl.SSLContext:
    if credentials.ca is None:
        context = ssl.create_default_context()
    else:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        load_authorities(context, credentials.ca)
    if credentials.certificate is not None and credentials.key is not None:
        load_certificate(context, credentials.certificate, credentials.key)
    return context


def _untrusted(
    error: ssl.SSLCertVerificationError, host: str, where: str, credentials: Credentials
) -> Failure:
    shown = f"the certificate of {where}"
    if error.verify_code in _UNKNOWN_AUTHORITY:
        if credentials.ca is None:
            return AccessDenied(
                f"{shown} is signed by an authority that this client does not know: give the "
                "authority's certificate as ca (--tls-ca, ZENOH_TF_CA)",
                field="ca",
            )
        return AccessDenied(
            f"{shown} is not signed by any authority in {os.fspath(credentials.ca)!r}: this may "
            "be another server than the one meant, or the wrong ca file",
            field="ca",
        )
    if error.verify_code == _EXPIRED:
        return AccessDenied(f"{shown} has expired: the server needs a new one", field="ca")
    if error.verify_code == _NOT_YET_VALID:
        return AccessDenied(
            f"{shown} is not valid yet: check the clocks of both machines", field="ca"
        )
    if error.verify_code in _WRONG_NAME:
        return AccessDenied(
            f"{shown} is not for the name {host!r}: connect to a name that is in the "
            "certificate, or make one with this name",
            field="endpoint",
        )
    return AccessDenied(f"{shown} cannot be trusted: {error.verify_message}", field="ca")


def _refused_certificate(error: ssl.SSLError, where: str, credentials: Credentials) -> Failure:
    if credentials.certificate is None:
        return AccessDenied(
            f"{where} wants a client's certificate: give certificate and key "
            "(--tls-certificate and --tls-key, ZENOH_TF_CERTIFICATE and ZENOH_TF_KEY)",
            field="certificate",
        )
    reason = (error.reason or str(error)).lower().replace("_", " ")
    reason = reason.rpartition("alert ")[2]
    return AccessDenied(
        f"{where} refuses the certificate {os.fspath(credentials.certificate)!r}: {reason}",
        field="certificate",
    )


def _explain_secure_session(secure: ssl.SSLSocket, where: str, credentials: Credentials) -> Failure:
    # With TLS 1.3 a server refuses the client's certificate only after the handshake.
    secure.settimeout(_REFUSAL_S)
    with contextlib.suppress(TimeoutError):
        secure.recv(1)
    secure.settimeout(_TIMEOUT_S)
    try:
        is_zenoh = _is_zenoh(secure)
    except OSError:
        is_zenoh = False
    return _refused(where, credentials) if is_zenoh else _not_zenoh(where)


def _speaks_tls(connection: socket.socket) -> bool:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    try:
        with context.wrap_socket(connection):
            return True
    except OSError:
        return False


def is_final(failure: Failure, previous: Failure | None) -> bool:
    """Whether another attempt would fail as well. `previous`: what an attempt before has shown.

    A server that has come up since an attempt began looks like one that refuses the user. So that
    must be found after two attempts.
    """
    if isinstance(failure, ServerUnavailable):
        return False
    return failure.field != _USER or isinstance(previous, AccessDenied)


def _not_zenoh(where: str) -> Failure:
    return ServerUnavailable(f"{where} does not answer as Zenoh: is a zenoh-tf-server there?")


def _refused(where: str, credentials: Credentials) -> Failure:
    """The error if the port is fine and Zenoh opens no session, without giving a reason."""
    room = "or it has no room for another client (--limit connections=N)"
    if credentials.user is None:
        return AccessDenied(
            f"{where} wants a user and a password: give user and password (--user and "
            f"--password-file, ZENOH_TF_USER and ZENOH_TF_PASSWORD_FILE); {room}",
            field=_USER,
        )
    return AccessDenied(
        f"{where} refuses user {credentials.user!r}: no such user, or the wrong password; {room}",
        field=_USER,
    )


def _is_zenoh(connection: socket.socket) -> bool:
    """Whether Zenoh answers. Raises OSError, of which TimeoutError means that nothing answers."""
    connection.sendall(_EMPTY_MESSAGE)
    data = connection.recv(1024)
    return len(data) > 2 and int.from_bytes(data[:2], "little") == len(data) - 2
