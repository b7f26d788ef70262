"""Checks of a request that Zenoh's access control cannot make, because it sees keys only.

With access rules, the key of a write names what it writes: `commit/{authority}`,
`batch/{authority}`, `admin/{what}`. Zenoh lets a client use the keys that its rules allow; here the
message must agree with its key.

Thread safety: all methods.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from zenoh_tf import wire
from zenoh_tf._net import keys
from zenoh_tf.errors import AccessDenied

from ..security import access_rules
from ..security.access_rules import AccessRule


class RequestGuard:
    """Refuses requests before they run."""

    def __init__(
        self,
        rules: Sequence[AccessRule] = (),
        *,
        admin: bool = True,
        certificate_of: Callable[[str], str | None] = lambda client: None,
    ) -> None:
        """`certificate_of`: from a client's Zenoh id to the common name of its certificate."""
        self._rules = tuple(rules)
        self._admin = admin
        self._certificate_of = certificate_of
        #: The types of requests that `check` may refuse.
        self.checked: frozenset[str] = frozenset()
        if rules:
            self.checked = frozenset(("commit", "batch", "admin"))
        elif not admin:
            self.checked = frozenset(("admin",))

    @property
    def keyed(self) -> bool:
        """True if the keys of writes name what is written."""
        return bool(self._rules)

    def check(self, request_type: str, chunk: str | None, message: wire.Message) -> None:
        """Check a request of one of the types `checked`; may complete its message.

        Args:
            request_type: One of `keys.REQUEST_TYPES`.
            chunk: What stands behind it in the key; None if nothing does.
            message: The request.

        Raises:
            AccessDenied: The request must not run.
            InvalidArgumentException: The key is malformed.
        """
        if request_type == "admin" and not self._admin:
            raise AccessDenied(
                f"admin request {message.get('what')!r} refused: the server runs with --no-admin",
                field="what",
            )
        if not self._rules:
            return
        subject = None if chunk is None else keys.unescape(chunk)
        if request_type == "commit":
            _bind_authority(message, subject, "commit")
        elif request_type == "admin":
            if subject is None or message.get("what") != subject:
                raise _must_name("admin", "what")
        elif request_type == "batch":
            for entry_type, body in wire.parse_batch(message):
                if entry_type == "commit":
                    _bind_authority(body, subject, "batch")
                elif subject is not None:
                    # A client that may only publish must not read on the key of its writes.
                    raise AccessDenied(
                        f"a {entry_type} in a batch that writes: with access rules, a batch reads "
                        "or writes, not both",
                        field="operations",
                    )

    def access(self, message: wire.Message) -> dict[str, Any] | None:
        """What the client that asks `hello` may do; None if there are no rules.

        It informs only: user and id are what the client says. Zenoh knows better, and enforces.
        """
        if not self._rules:
            return None
        user = _optional_text(message, "user")
        client = _optional_text(message, "client")
        certificate = None if client is None else self._certificate_of(client)
        return {
            "certificate": certificate,
            **access_rules.granted(self._rules, user, certificate),
        }


def _optional_text(message: wire.Message, field: str) -> str | None:
    return wire.text(message, field) if field in message else None


def _bind_authority(commit: wire.Message, authority: str | None, request_type: str) -> None:
    """Give the commit the key's authority, which its own must not contradict."""
    if authority is None:
        raise _must_name(request_type, "authority")
    if commit.setdefault("authority", authority) != authority:
        raise AccessDenied(
            f"a commit as authority {commit['authority']!r} was sent on the key of {authority!r}: "
            "with access rules, one request writes as one authority",
            field="authority",
        )


def _must_name(request_type: str, what: str) -> AccessDenied:
    return AccessDenied(
        f"the server has access rules: a request that writes goes to {request_type}/{{{what}}}, "
        f"which must be the {what} in the message",
        field=what,
    )
