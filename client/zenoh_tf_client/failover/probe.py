"""Whether a tree is served at an endpoint, by a session of its own."""

from __future__ import annotations

import time
from typing import Final

import zenoh

from zenoh_tf import wire
from zenoh_tf._net import keys
from zenoh_tf._net.credentials import Credentials
from zenoh_tf._net.queries import Queries
from zenoh_tf.errors import TransformException

from ..requests import info
from ..session.calls import SessionCalls
from ..session.opening import try_session

#: How long each step may take: an endpoint that needs longer is no gain.
_STEP_S: Final = 1.0


def serves(endpoint: str, tree: str, credentials: Credentials) -> bool:
    """Whether this client is let in there, and a replica or the server answers `hello`.

    A replica listens before it has its copy, and a router may have lost its servers.
    """
    try:
        session = try_session([endpoint], _STEP_S, credentials)
    except (zenoh.ZError, TransformException):
        return False
    calls = SessionCalls(session.close)
    try:
        queries = Queries(session, calls, str(session.zid()), f"the server at {endpoint}")
        hello = wire.pack(info.hello(credentials.user, clock_ns=time.time_ns()).body())
        with calls:
            routers = list(map(str, session.info.routers_zid()))
        near = [keys.replica_request(tree, router, "hello") for router in routers]
        for key in (*near, keys.request(tree, "hello")):
            reply = queries.ask(zenoh.KeyExpr(key), hello, _STEP_S)
            if type(reply) is bytes and "error" not in wire.unpack(reply, wire.MAX_REPLY_BYTES):
                return True
    except TransformException:
        pass
    finally:
        calls.close()
    return False
