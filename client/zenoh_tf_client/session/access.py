"""What the server's access rules allow this client, as the server has told it.

Zenoh drops denied messages without a word. So the client checks its own requests first, and says
what is not allowed, to whom, and what would be.
"""

from __future__ import annotations

from typing import Any

from zenoh_tf import wire
from zenoh_tf._net import keys
from zenoh_tf.errors import AccessDenied, ProtocolError

#: Query families that every client with rights may ask, and those that need the right to read.
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
        if "replica_user" in record:  # the rules are for all clients of the replica together
            self._who += f", as a client of a replica with user {record['replica_user']!r},"

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

    def key(self, operation: str, body: wire.Message) -> str:
        """The key of a request.

        Raises:
            AccessDenied: The rules do not allow the request.
        """
        if operation == "commit":
            return self._write_key(operation, body.get("authority", ""))
        if operation == "admin":
            what = body["what"]
            self._check_may(what)
            return keys.keyed_operation(self._tree, "admin", what)
        if operation == "batch" and (authorities := _authorities(body)):
            if len(authorities) > 1:
                names = " and ".join(map(repr, sorted(authorities)))
                raise AccessDenied(
                    f"the batch writes as {names}: with the access rules at {self._where}, a batch "
                    "writes as one authority",
                    field="authority",
                )
            if any(kind != "commit" for kind, _ in body["operations"]):
                raise AccessDenied(
                    f"the batch reads and writes: with the access rules at {self._where}, a batch "
                    "does one of both",
                    field="operations",
                )
            return self._write_key(operation, authorities.pop())
        if operation in _READS:
            self._check_may("read")
        return keys.operation(self._tree, operation)

    def _write_key(self, operation: str, authority: str) -> str:
        self.check_publish(authority)
        return keys.keyed_operation(self._tree, operation, authority)

    def _check_may(self, what: str) -> None:
        if what not in self._may:
            allowed = ", ".join(self._may) or "none"
            raise AccessDenied(
                f"{self._who} may not {what} at {self._where}: the access rules allow it these "
                f"operations: {allowed}",
                field="operation",
                value=what,
            )


def _authorities(batch: wire.Message) -> set[str]:
    return {body.get("authority", "") for kind, body in batch["operations"] if kind == "commit"}


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
