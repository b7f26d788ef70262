"""Every error of zenoh-tf, embedded and remote.

    TransformException
    ├── LookupException                     a frame is unknown, or the path is too long or a loop
    │   └── ServerStarting                      it may come back: its server has just started
    ├── ConnectivityException               both frames are known, but no path connects them
    ├── InvalidArgumentException            an argument is invalid
    ├── TimeoutException                    no answer in time
    ├── ExtrapolationException              a link has no data for the requested time
    │   ├── NoDataForExtrapolationException     it holds a single sample, at another time
    │   ├── BackwardExtrapolationException      the time is older than its oldest sample
    │   ├── ForwardExtrapolationException       the time is newer than its newest sample
    │   ├── GapTooLong                          its samples are farther apart than the limit
    │   └── TooUncertain                        an estimate's error may exceed the caller's limit
    ├── TransactionConflict                 a frame that a transaction read has changed since
    ├── LimitExceeded                       a documented limit is reached
    └── ServiceException                    the service failed, not the tree
        ├── ServerUnavailable               no server answered
        ├── OutcomeUnknown                  a write was sent, but no reply came
        ├── ServerRestarted                 the server instance of the earlier reads is gone
        ├── ProtocolError                   a message is malformed
        ├── ServerBusy                      the server has too much to do: try again later
        ├── AccessDenied                    the server's access rules do not allow this
        ├── NotDurable                      a write was applied, but the server cannot store it
        └── ReadOnlyReplica                 the server is a replica: its primary accepts writes

Each error carries its facts as fields (``FACTS``), also over the network; a field that does not
apply is ``None``. The classes up to the extrapolation errors are tf2's, except `GapTooLong` and
`TooUncertain`.
"""

from __future__ import annotations

import functools
import sys
from typing import Final

from .text import cut

#: Field name -> meaning. The same names are used on the wire (docs/reference/protocol.md).
FACTS = {
    "target_frame": "the lookup's target",
    "source_frame": "the lookup's source",
    "frame": "the offending frame, or the child frame of the offending link",
    "parent_frame": "the parent frame of the offending link",
    "target_root": "not connected: the root of the target's tree",
    "source_root": "not connected: the root of the source's tree",
    "stamp_ns": "the requested time, nanoseconds",
    "oldest_stamp_ns": "the oldest time that the link can serve, nanoseconds",
    "newest_stamp_ns": "the newest time that the link can serve, nanoseconds",
    "field": "the argument or message field at fault",
    "limit": "the limit that is reached",
    "value": "the value at fault",
    "retry_after_s": "server busy or just started: try again after this many seconds",
    "error_m": "an estimate's bound of the error of the position, metres",
    "error_rad": "an estimate's bound of the error of the orientation, radians",
    "gap_ns": "the time between two samples that a lookup would interpolate over, nanoseconds",
    "by_ns": "how far an estimate carries a link beyond its newest sample, nanoseconds",
}


#: Characters of an error's message, and of a fact that is text. An error may name what a client
#: sent, but must not repeat megabytes of it in replies and logs.
MAX_MESSAGE_CHARS: Final = 2000
MAX_FACT_CHARS: Final = 1000


class TransformException(Exception):
    """Base of every error; see the module's tree and ``FACTS``. Long texts are cut."""

    #: One byte in ``TransformArray.status`` and on the wire; 0 means no error.
    code = 1

    target_frame: str | None = None
    source_frame: str | None = None
    frame: str | None = None
    parent_frame: str | None = None
    target_root: str | None = None
    source_root: str | None = None
    stamp_ns: int | None = None
    oldest_stamp_ns: int | None = None
    newest_stamp_ns: int | None = None
    field: str | None = None
    limit: int | float | None = None
    value: int | float | str | None = None
    retry_after_s: float | None = None
    error_m: float | None = None
    error_rad: float | None = None
    gap_ns: int | None = None
    by_ns: int | None = None

    def __init__(self, message: str = "", **facts: object) -> None:
        super().__init__(cut(message, MAX_MESSAGE_CHARS))
        for name, fact in facts.items():
            if name not in FACTS:
                raise TypeError(f"unknown fact {name!r}")
            setattr(self, name, cut(fact, MAX_FACT_CHARS) if isinstance(fact, str) else fact)

    if sys.version_info < (3, 11):

        def add_note(self, note: str) -> None:
            """As in Python 3.11, where a traceback prints the notes, too."""
            self.__dict__.setdefault("__notes__", []).append(note)

    @property
    def facts(self) -> dict[str, object]:
        """The fields that apply, by name."""
        return {name: value for name, value in vars(self).items() if name in FACTS}

    def __reduce__(self) -> tuple[object, ...]:
        return functools.partial(type(self), str(self), **self.facts), ()


class LookupException(TransformException):
    """A frame does not exist, or the path is longer than ``max_depth`` or a loop."""

    code = 2


class ConnectivityException(TransformException):
    """Both frames exist, but no path connects them; ``target_root`` and ``source_root`` name their
    roots. If the server has just started, ``retry_after_s`` says when to ask again."""

    code = 3


class InvalidArgumentException(TransformException, ValueError):
    """An argument is invalid; ``field`` names it. Also a ValueError."""

    code = 4


class WrongType(InvalidArgumentException, TypeError):
    """An argument, or a field of a message, has a wrong type. Also Python's own TypeError."""


def must_be(field: str, expected: str, value: object) -> InvalidArgumentException:
    """The error of an argument that is not as expected."""
    return InvalidArgumentException(f"{field} must be {expected}, not {value!r}", field=field)


def must_be_str(field: str, value: object) -> WrongType:
    """The error of an argument that is no str."""
    return WrongType(f"{field} must be a str, not {type(value).__name__}", field=field)


class TimeoutException(TransformException, TimeoutError):
    """There was no answer in time. Also a TimeoutError."""

    code = 5


class ExtrapolationException(TransformException):
    """A link has no data for the requested time; ``frame`` is its child."""

    code = 6


class NoDataForExtrapolationException(ExtrapolationException):
    """The link holds a single sample, at another time."""

    code = 7


class BackwardExtrapolationException(ExtrapolationException):
    """The requested time is older than the link's oldest sample."""

    code = 8


class ForwardExtrapolationException(ExtrapolationException):
    """The requested time is newer than the link's newest sample."""

    code = 9


class TransactionConflict(TransformException):
    """A frame that the transaction read has changed since; run the transaction again."""

    code = 10


class LimitExceeded(TransformException):
    """A limit is reached; ``field``, ``limit`` and ``value`` say which."""

    code = 11


class ServiceException(TransformException):
    """The service failed, not the tree."""

    code = 12


class ServerUnavailable(ServiceException):
    """No server answered within the time-out."""

    code = 13


class OutcomeUnknown(ServiceException):
    """A write was sent, but no reply came: it may have been applied."""

    code = 14


class ServerRestarted(ServiceException):
    """Another server instance has taken over since the earlier reads."""

    code = 15


class ProtocolError(ServiceException):
    """A message is malformed; ``field`` names the part at fault."""

    code = 16


class ServerBusy(ServiceException):
    """The server has too much to do and did not run the request; send it again after
    ``retry_after_s``."""

    code = 17


class AccessDenied(ServiceException):
    """The server's access rules do not allow the connection or the request."""

    code = 18


class NotDurable(ServiceException):
    """The write was applied and all readers see it, but the server's disk does not accept it: a
    server that ends now loses it. The server keeps trying."""

    code = 19


class ReadOnlyReplica(ServiceException):
    """A write was sent to a replica, which accepts none: nothing was written; `value` names the
    endpoints of its primary."""

    code = 20


class TooUncertain(ExtrapolationException):
    """An estimate may be wrong by more than the caller accepts. `error_m`, `error_rad` and `by_ns`
    are the estimate's, `limit` is the one exceeded, and the link is the one that adds most."""

    code = 21


class GapTooLong(ExtrapolationException):
    """A link's samples around the requested time are farther apart than the caller accepts.
    `oldest_stamp_ns` and `newest_stamp_ns` are their stamps, `gap_ns` is the time between them, and
    `limit` is the caller's, in seconds."""

    code = 22


class ServerStarting(LookupException):
    """The server has just started and does not have the frame yet: its publisher may be about to
    connect again. Ask again after `retry_after_s`; a lookup with a time-out waits for it."""

    code = 23


#: Errors of lookups that may succeed after a later write.
MAY_SUCCEED_LATER: Final = (LookupException, ConnectivityException, ExtrapolationException)

#: Code -> class, for ``TransformArray.status`` and the wire.
BY_CODE: dict[int, type[TransformException]] = {
    kind.code: kind
    for kind in [*globals().values()]
    if isinstance(kind, type) and issubclass(kind, TransformException) and "code" in vars(kind)
}

__all__ = ["BY_CODE", "FACTS", "WrongType", *(kind.__name__ for kind in BY_CODE.values())]
