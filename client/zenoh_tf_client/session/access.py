"""What the server's access rules allow this client, by the server's `hello`.

Zenoh drops denied messages without a word. So the client checks its own requests first, and says
what is not allowed, to whom, and what would be.
"""

from __future__ import annotations

from typing import Any

from zenoh_tf import wire
from zenoh_tf._net import keys
from zenoh_tf.errors import AccessDenied, ProtocolError

#: Requests that every client with rights may ask, and those that need the right to read.
_READS = ("lookup", "batch", "info", "snapshot", "missed")


class Access:
    """The rights of one client. Thread safety: immutable."""

    def __init__(self, tree: str, where: str, user: str | None, record: Any) -> None:
        """Parse `access` of a `hello` reply.

        Raises:
            ProtocolError: It is malformed.
        """
        self._tree = tree
        self._where = where
        if type(record) is not dict:
            raise ProtocolError(f"access in the reply is not a map: {record!r}", field="access")
        self._may = _texts(record, "may")
        self._publish = _texts(record, "publish")
        self._who = _who(user, record.get("certificate"))

    def check_any(self) -> None:
        """Raise AccessDenied if this client may do nothing at all."""
        if not self._may and not self._publish:
            raise AccessDenied(
                f"{self._who} may do nothing at {self._where}: no access rule of the server names "
                "it; ask the operator to add one"
            )

    def check_publish(self, authority: str) -> None:
        """Raise AccessDenied if this client may not publish as `authority`."""
        if not any(_matches(pattern, authority) for pattern in self._publish):
            allowed = ", ".join(map(repr, self._publish)) or "nobody"
            raise AccessDenied(
                f"{self._who} may not publish as {authority!r} at {self._where}: the access rules "
                f"allow it to publish as {allowed}",
                field="authority",
                value=authority,
            )

    def key(self, request_type: str, body: wire.Message) -> str:
        """The key of a request.

        Raises:
            AccessDenied: The rules do not allow the request.
        """
        if request_type == "commit":
            return self._write_key(request_type, body.get("authority", ""))
        if request_type == "admin":
            what = body["what"]
            self._check_may(what)
            return keys.write_request(self._tree, "admin", what)
        if request_type == "batch" and (authorities := _authorities(body)):
            if len(authorities) > 1:
                names = " and ".join(map(repr, sorted(authorities)))
                raise AccessDenied(
                    f"the batch writes as {names}: with the access rules at {self._where}, a batch "
                    "writes as one authority",
                    field="authority",
                )
            if any(request_type != "commit" for request_type, _ in body["operations"]):
                raise AccessDenied(
                    f"the batch reads and writes: with the access rules at {self._where}, a batch "
                    "does one of both",
                    field="operations",
                )
            return self._write_key(request_type, authorities.pop())
        if request_type in _READS:
            self._check_may("read")
        return keys.request(self._tree, request_type)

    def _write_key(self, request_type: str, authority: str) -> str:
        self.check_publish(authority)
        return keys.write_request(self._tree, request_type, authority)

    def _check_may(self, right: str) -> None:
        if right not in self._may:
            allowed = ", ".join(self._may) or "none"
            raise AccessDenied(
                f"{self._who} may not {right} at {self._where}: the access rules allow it these "
                f"rights: {allowed}",
                field="right",
                value=right,
            )


def _authorities(batch: wire.Message) -> set[str]:
    return {body.get("authority", "") for each, body in batch["operations"] if each == "commit"}


def _matches(pattern: str, authority: str) -> bool:
    prefix = pattern.removesuffix("*")
    return authority == pattern if prefix == pattern else authority.startswith(prefix)


def _texts(record: dict[str, Any], field: str) -> list[str]:
    values = record.get(field)
    if type(values) is not list or not all(type(value) is str for value in values):
        raise ProtocolError(f"{field} in the reply is not a list of texts", field=field)
    return values


def _who(user: str | None, certificate: object) -> str:
    names = []
    if user is not None:
        names.append(f"user {user!r}")
    if isinstance(certificate, str):
        names.append(f"certificate {certificate!r}")
    return " with ".join(names) or "this client, which shows no user or certificate,"
