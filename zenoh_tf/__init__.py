"""zenoh-tf: a transactional transform tree, embedded or served over Zenoh.

This package has the embedded tree, and the types that client and server share.
``zenoh_tf_client`` has the same interface on a connection to a server.
"""

from importlib import import_module
from typing import TYPE_CHECKING

try:
    from zenoh_tf._core import Transform
except ModuleNotFoundError as error:
    if error.name != "zenoh_tf._core":
        raise
    raise ImportError(
        f"{__path__[0]} is a folder of zenoh-tf's sources, without the native module: it hides the "
        "installed package, as Python searches the current folder first. Run Python in another "
        "folder or with -P, or build the native module here with `make native`"
    ) from None

from zenoh_tf import errors
from zenoh_tf._core import Estimate, LatestTransform, StampedTransform
from zenoh_tf.array import TransformArray
from zenoh_tf.errors import (
    AccessDenied,
    BackwardExtrapolationException,
    ConnectivityException,
    ExtrapolationException,
    ForwardExtrapolationException,
    GapTooLong,
    InvalidArgumentException,
    LimitExceeded,
    LookupException,
    NoDataForExtrapolationException,
    NotDurable,
    OutcomeUnknown,
    ProtocolError,
    ReadOnlyReplica,
    ServerBusy,
    ServerRestarted,
    ServerUnavailable,
    ServiceException,
    TimeoutException,
    TooUncertain,
    TransactionConflict,
    TransformException,
)
from zenoh_tf.estimate import EstimateArray
from zenoh_tf.tree import TransformTree
from zenoh_tf.velocity import Velocity

if TYPE_CHECKING:
    from zenoh_tf.gates.gate import Gate
    from zenoh_tf.gates.queue import Dropped, Passed
    from zenoh_tf.introspection.explanation import Explanation, LinkReport
    from zenoh_tf.introspection.frame_info import (
        AuthorityInfo,
        ClientInfo,
        FrameChange,
        FrameInfo,
        Replacement,
        TimeJump,
    )

    __version__: str
else:
    # What many programs need not wait for.
    _LATER = {
        "AuthorityInfo": "zenoh_tf.introspection.frame_info",
        "ClientInfo": "zenoh_tf.introspection.frame_info",
        "Dropped": "zenoh_tf.gates.queue",
        "Explanation": "zenoh_tf.introspection.explanation",
        "FrameChange": "zenoh_tf.introspection.frame_info",
        "FrameInfo": "zenoh_tf.introspection.frame_info",
        "Gate": "zenoh_tf.gates.gate",
        "LinkReport": "zenoh_tf.introspection.explanation",
        "Passed": "zenoh_tf.gates.queue",
        "Replacement": "zenoh_tf.introspection.frame_info",
        "TimeJump": "zenoh_tf.introspection.frame_info",
    }

    def __getattr__(name: str) -> object:
        if name == "__version__":
            return import_module("importlib.metadata").version("zenoh-tf")
        if name not in _LATER:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return getattr(import_module(_LATER[name]), name)


def __dir__() -> list[str]:
    return __all__


__all__ = [
    "AccessDenied",
    "AuthorityInfo",
    "BackwardExtrapolationException",
    "ClientInfo",
    "ConnectivityException",
    "Dropped",
    "Estimate",
    "EstimateArray",
    "Explanation",
    "ExtrapolationException",
    "ForwardExtrapolationException",
    "FrameChange",
    "FrameInfo",
    "GapTooLong",
    "Gate",
    "InvalidArgumentException",
    "LatestTransform",
    "LimitExceeded",
    "LinkReport",
    "LookupException",
    "NoDataForExtrapolationException",
    "NotDurable",
    "OutcomeUnknown",
    "Passed",
    "ProtocolError",
    "ReadOnlyReplica",
    "Replacement",
    "ServerBusy",
    "ServerRestarted",
    "ServerUnavailable",
    "ServiceException",
    "StampedTransform",
    "TimeJump",
    "TimeoutException",
    "TooUncertain",
    "TransactionConflict",
    "Transform",
    "TransformArray",
    "TransformException",
    "TransformTree",
    "Velocity",
    "__version__",
    "errors",
]
