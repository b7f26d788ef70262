"""Opens the links of a connection: the first one, and others when the tree is not there any more.

The first endpoint of the list counts at which the server of the tree answers. A link that is lost
is replaced by one at the first other endpoint that answers, or at the same one.

Thread safety: one thread at a time.
"""

from __future__ import annotations

import time
import weakref
from collections.abc import Sequence
from typing import Final

import zenoh

from zenoh_tf._net import zenoh_config
from zenoh_tf._net.credentials import Credentials
from zenoh_tf.errors import ServerUnavailable, TransformException

from ..exchange import Exchange
from . import opening
from .link import Link
from .served_trees import no_server_message, served_trees

_HELLO_PERIOD_S: Final = 0.05
#: If other trees are served, the wait for one that is not ends after this time.
_OTHER_TREES_GRACE_S: Final = 1.0
_OTHER_TREES_PERIOD_S: Final = 0.25
_OTHER_TREES_TIMEOUT_S: Final = 0.4
#: How long the server at one of several endpoints may take to answer, and how long its router to
#: learn of it (eclipse-zenoh/zenoh#2767).
_ANSWER_S: Final = 1.0
_DECLARED_S: Final = 0.25


class Links:
    """Opens links for one exchange."""

    def __init__(
        self,
        endpoints: Sequence[str],
        tree: str,
        timeout_s: float,
        credentials: Credentials,
        exchange: Exchange,
    ) -> None:
        self._endpoints = endpoints
        self._address = zenoh_config.addresses(endpoints)  # for messages: without secrets
        self._tree = tree
        self._timeout_s = timeout_s
        self._credentials = credentials
        self._exchange: Exchange = weakref.proxy(exchange)  # which has this
        #: How long one attempt at one of several endpoints may take: longer on a slow network.
        self._attempt_s = opening.FIRST_OF_SEVERAL_S
        self._link: Link | None = None  # the one in use

    def first(self) -> Link:
        """The first link. Raises what `Connection` raises."""
        deadline_s = time.monotonic() + self._timeout_s
        if len(self._endpoints) > 1:
            self._link = self._first_of_several(deadline_s)
            return self._link
        (endpoint,) = self._endpoints
        session = opening.open_session(endpoint, self._tree, self._timeout_s, self._credentials)
        self._link = link = self._make(session, endpoint)
        try:
            self._wait_for_server(link, deadline_s)
        except BaseException:
            link.close()
            raise
        return link

    def another(self) -> Link | None:
        """A link in place of the one that is lost; None if the tree is nowhere now.

        Raises ServerUnavailable if the program is ending, or its process was forked.
        """
        assert self._link is not None
        lost = self._link.endpoint
        endpoints = [*(each for each in self._endpoints if each != lost), lost]
        try:
            link, _ = self._round(endpoints, time.monotonic() + self._timeout_s)
        finally:
            self._exchange.client_id = self._link.client_id
        if link is not None:
            self._link = link
            self._exchange.client_id = link.client_id
        return link

    def _make(self, session: zenoh.Session, endpoint: str) -> Link:
        server = f"the server of tree {self._tree!r} at {self._address}"
        link = Link(session, endpoint, self._tree, server)
        self._exchange.client_id = link.client_id
        return link

    # --- one endpoint

    def _wait_for_server(self, link: Link, deadline_s: float) -> None:
        """Ask until a server answers, because it may still be starting. Give up early if the
        network serves other trees only, because the name is then probably wrong."""
        next_check_s = time.monotonic() + _OTHER_TREES_GRACE_S
        while True:
            left_s = deadline_s - time.monotonic()
            try:
                self._exchange.greet_at(link.queries, max(left_s, 0.1))
                return
            except ServerUnavailable:
                is_last = left_s <= _HELLO_PERIOD_S
                if is_last or time.monotonic() >= next_check_s:
                    trees = served_trees(link.session, _OTHER_TREES_TIMEOUT_S)
                    if is_last or (trees and self._tree not in trees):
                        raise self._no_server(trees) from None
                    next_check_s = time.monotonic() + _OTHER_TREES_PERIOD_S
            time.sleep(_HELLO_PERIOD_S)

    def _no_server(self, trees: set[str]) -> ServerUnavailable:
        return ServerUnavailable(
            no_server_message(self._tree, self._address, trees, self._timeout_s)
        )

    # --- several endpoints

    def _first_of_several(self, deadline_s: float) -> Link:
        failure: TransformException | None = None
        while True:
            link, trees = self._round(self._endpoints, deadline_s)
            if link is not None:
                return link
            is_last = time.monotonic() >= deadline_s
            if trees is None and (is_last or not isinstance(failure, ServerUnavailable)):
                previous = failure
                from zenoh_tf._zenoh import connect_failure  # noqa: PLC0415 - it loads ssl, which is slow

                failure = connect_failure.explain_all(
                    self._endpoints, self._tree, self._timeout_s, self._credentials
                )
                if is_last or connect_failure.is_final(failure, previous):
                    raise failure
            elif trees is not None and is_last:
                raise self._no_server(trees)
            time.sleep(_HELLO_PERIOD_S)

    def _round(
        self, endpoints: Sequence[str], deadline_s: float
    ) -> tuple[Link | None, set[str] | None]:
        """The link at the first of `endpoints` where the server answers. If there is none: the
        trees that are served there; None if nobody is there."""
        trees: set[str] | None = None
        took_s = 0.0
        for endpoint in endpoints:
            begin_s = time.monotonic()
            attempt_s = max(min(self._attempt_s, deadline_s - begin_s), opening.MIN_ATTEMPT_S)
            session = opening.try_endpoint(endpoint, attempt_s, self._credentials)
            if session is None:
                took_s = max(took_s, time.monotonic() - begin_s)
                continue
            link = self._make(session, endpoint)
            link.watch()
            if self._answers(link):
                return link, None
            trees = (trees or set()) | served_trees(link.session, _OTHER_TREES_TIMEOUT_S)
            link.close()
        if took_s >= self._attempt_s:  # it may have been too short
            self._attempt_s = min(2 * self._attempt_s, opening.MAX_ATTEMPT_S)
        return None, trees

    def _answers(self, link: Link) -> bool:
        """Whether the server of the tree answers there."""
        begin_s = time.monotonic()
        while True:
            try:
                self._exchange.greet_at(link.queries, _ANSWER_S)
                return True
            except TransformException:
                if time.monotonic() - begin_s > _DECLARED_S:
                    return False
            time.sleep(_HELLO_PERIOD_S)
