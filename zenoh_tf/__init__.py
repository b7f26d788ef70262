"""zenoh-tf: a transactional transform tree, embedded or served over Zenoh.

This package has the embedded tree, and the types that client and server share.
``zenoh_tf_client`` has the same interface on a connection to a server.
"""

from importlib.metadata import version as _version

from zenoh_tf import errors
from zenoh_tf._core import Estimate, LatestTransform, StampedTransform, Transform
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
    ReplicaBehind,
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
from zenoh_tf.gate import Gate
from zenoh_tf.gate_queue import Dropped, Passed
from zenoh_tf.introspection.explanation import Explanation, LinkReport
from zenoh_tf.introspection.frame_info import (
    AuthorityInfo,
    ClientInfo,
    FrameChange,
    FrameInfo,
    Replacement,
    TimeJump,
)
from zenoh_tf.tree import TransformTree
from zenoh_tf.velocity import Velocity

__version__ = _version("zenoh-tf")


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
    "Replacement",
    "ReplicaBehind",
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
