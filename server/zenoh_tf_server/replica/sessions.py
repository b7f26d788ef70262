"""The Zenoh sessions of a replica: towards its primary, and for its clients.

Zenoh's access control knows a connection by its user, certificate and protocol. By these, the one
to the primary may equal that of a client. So a replica that asks its clients who they are
has two routers: one links itself to the primary, the other listens for clients, and a Unix socket
joins them. The rules of the second one allow everything on that socket, and to clients what the
primary allows to this replica's user. A replica that anybody may use has one router for both.

Thread safety: none; `ReplicaServer` opens and closes them.
"""

from __future__ import annotations

import os
import secrets
import tempfile
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final

import zenoh

from zenoh_tf import wire
from zenoh_tf._net import credentials, keys

from ..limits import Limits
from ..process.network import CONNECT_TIMEOUT_S, RETRY, NetworkError, open_router
from ..security import access_control
from ..security.access_rules import EVERYTHING, AccessRule
from ..security.settings import Security

_PERIOD_S: Final = 0.2
_USER: Final = "replica"  # of the link between both routers
#: Where Zenoh reads which user a session connects as, and which users it lets in.
_USERPWD: Final = "transport/auth/usrpwd"


class ReplicaSessions:
    """Links itself to the primary from construction on, now and whenever the link was lost.

    Raises NetworkError.
    """

    def __init__(
        self, listen: Sequence[str], primary: Sequence[str], limits: Limits, security: Security
    ) -> None:
        self._listen = listen
        self._limits = limits
        self._security = security
        self._stack = ExitStack()
        self._joint = ""  # the endpoint between both routers
        self._joint_settings: dict[str, object] = {}  # of the router that connects to it
        endpoints = listen
        if not security.authenticates:
            settings = security.open_replica_settings()
        else:
            settings = credentials.zenoh_settings(security.credentials)
            folder = Path(self._stack.enter_context(tempfile.TemporaryDirectory()))
            self._joint = f"{access_control.PRIMARY_PROTOCOL}/{folder / 'primary'}"
            endpoints = [self._joint]
            if security.credentials.user is not None:
                settings |= self._require_password(folder)
        #: Clients' messages come here only if the rules let them through.
        self.primary = self._open(endpoints, primary, settings)

    def open_clients(self, tree: str, access: Mapping[str, Any] | None) -> zenoh.Session:
        """The router for clients. `access`: what the primary allows, as `hello` says; None: all.

        Raises:
            NetworkError: Its endpoints cannot be listened on.
        """
        if not self._joint:
            return self.primary
        rule = EVERYTHING
        if access is not None:
            rule = AccessRule(may=frozenset(access["may"]), publish=tuple(access["publish"]))
        settings = self._security.listen_settings() | self._joint_settings
        settings["access_control"] = access_control.replica_settings(tree, rule)
        session = self._open(self._listen, [self._joint], settings)
        _wait_until_joined(session, tree)
        return session

    def close(self) -> None:
        """Close both. May be called again."""
        self._stack.close()

    def _require_password(self, folder: Path) -> dict[str, object]:
        """Settings of a router that lets in the other one only. One that shows a user to the
        primary refuses everybody otherwise."""
        password = secrets.token_hex(16)
        users = folder / "users"
        users.touch(mode=0o600)
        users.write_text(f"{_USER}:{password}\n")
        self._joint_settings = {f"{_USERPWD}/user": _USER, f"{_USERPWD}/password": password}
        return {f"{_USERPWD}/dictionary_file": os.fspath(users)}

    def _open(
        self, listen: Sequence[str], connect: Sequence[str], settings: Mapping[str, object]
    ) -> zenoh.Session:
        limits = self._limits
        max_bytes = max(limits.message_bytes, wire.MAX_REPLY_BYTES)
        joining = {
            "connect/endpoints": list(connect),
            "connect/exit_on_failure": False,
            "connect/timeout_ms": -1,
            "connect/retry": RETRY,
        }
        try:
            session = open_router(listen, limits, max_bytes, {**settings, **joining})
        except NetworkError:
            self.close()
            raise
        self._stack.callback(session.close)
        return session


def _wait_until_joined(session: zenoh.Session, tree: str) -> None:
    """Wait until what clients ask the primary gets there: the first link is not there at once."""
    key, hello = keys.request(tree, "hello"), wire.pack(wire.call_body("hello"))
    deadline_s = time.monotonic() + CONNECT_TIMEOUT_S
    while not list(session.get(key, payload=hello, timeout=_PERIOD_S)):
        if time.monotonic() > deadline_s:
            return  # the primary has gone; the replica serves what it has
        time.sleep(_PERIOD_S / 10)
