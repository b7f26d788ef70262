"""Every error of zenoh-tf, embedded and remote.

    TransformException
    ├── LookupException                     a frame is unknown, or the way up runs in a loop
    ├── ConnectivityException               both frames are known, no path joins them
    ├── InvalidArgumentException            the call itself is wrong
    ├── TimeoutException                    no answer in time
    ├── ExtrapolationException              a link has no data for the time asked for
    │   ├── NoDataForExtrapolationException     it holds a single sample, at another time
    │   ├── BackwardExtrapolationException      the time is older than its oldest sample
    │   └── ForwardExtrapolationException       the time is newer than its newest sample
    ├── TransactionConflict                 what a transaction read has changed since
    ├── LimitExceeded                       a documented limit was hit
    └── ServiceException                    the service, not the tree
        ├── ServerUnavailable               no server answered
        ├── OutcomeUnknown                  a write was sent, its answer never came
        ├── ServerRestarted                 the server that was read from is gone
        └── ProtocolError                   a message is malformed

Facts travel as fields (``FACTS``); a field that does not apply is ``None``.
The class hierarchy up to the extrapolation errors is tf2's.
"""

from __future__ import annotations

#: Field name -> meaning. The same names are used on the wire (docs/protocol.md).
FACTS = {
    "target_frame": "the lookup's target",
    "source_frame": "the lookup's source",
    "frame": "the offending frame, or the child frame of the offending link",
    "parent_frame": "the parent frame of the offending link",
    "target_root": "no path: where the way up from the target ends",
    "source_root": "no path: where the way up from the source ends",
    "stamp_ns": "the time asked for",
    "oldest_stamp_ns": "the oldest time that the link can serve",
    "newest_stamp_ns": "the newest time that the link can serve",
    "field": "the argument or message field at fault",
    "limit": "the limit that was hit",
    "value": "the value that hit it",
}


class TransformException(Exception):
    """Base of every error; see the module's tree and ``FACTS``."""

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
    limit: int | None = None
    value: int | float | str | None = None

    def __init__(self, message: str = "", **facts: object) -> None:
        super().__init__(message)
        for name, fact in facts.items():
            if name not in FACTS:
                raise TypeError(f"unknown fact {name!r}")
            setattr(self, name, fact)

    @property
    def facts(self) -> dict[str, object]:
        """The fields that apply, by name."""
        return {name: value for name, value in vars(self).items() if name in FACTS}

    def __reduce__(self) -> tuple[object, ...]:
        return _rebuild, (type(self), str(self), self.facts)


def _rebuild(
    kind: type[TransformException], message: str, facts: dict[str, object]
) -> TransformException:
    return kind(message, **facts)


class LookupException(TransformException):
    code = 2


class ConnectivityException(TransformException):
    code = 3


class InvalidArgumentException(TransformException):
    code = 4


class TimeoutException(TransformException):
    code = 5


class ExtrapolationException(TransformException):
    code = 6


class NoDataForExtrapolationException(ExtrapolationException):
    code = 7


class BackwardExtrapolationException(ExtrapolationException):
    code = 8


class ForwardExtrapolationException(ExtrapolationException):
    code = 9


class TransactionConflict(TransformException):
    code = 10


class LimitExceeded(TransformException):
    code = 11


class ServiceException(TransformException):
    code = 12


class ServerUnavailable(ServiceException):
    code = 13


class OutcomeUnknown(ServiceException):
    code = 14


class ServerRestarted(ServiceException):
    code = 15


class ProtocolError(ServiceException):
    code = 16


#: Code -> class, for ``TransformArray.status`` and the wire.
BY_CODE: dict[int, type[TransformException]] = {
    kind.code: kind
    for kind in (
        TransformException,
        LookupException,
        ConnectivityException,
        InvalidArgumentException,
        TimeoutException,
        ExtrapolationException,
        NoDataForExtrapolationException,
        BackwardExtrapolationException,
        ForwardExtrapolationException,
        TransactionConflict,
        LimitExceeded,
        ServiceException,
        ServerUnavailable,
        OutcomeUnknown,
        ServerRestarted,
        ProtocolError,
    )
}

__all__ = ["BY_CODE", "FACTS", *(kind.__name__ for kind in BY_CODE.values())]
