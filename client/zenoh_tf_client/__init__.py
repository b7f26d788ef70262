"""The client library of zenoh-tf: a synchronous and an asynchronous client, and their results."""

from zenoh_tf import __version__
from zenoh_tf._net.credentials import Credentials

from .aio.batch import AsyncBatch
from .aio.broadcaster import AsyncBroadcaster
from .aio.client import AsyncTransformClient
from .aio.gate import AsyncGate
from .aio.mirror import AsyncMirror
from .aio.transaction import AsyncTransaction
from .aio.watch import AsyncWatch
from .batch import Batch
from .broadcaster import Broadcaster
from .client import TransformClient
from .handle import Handle
from .mirror import Mirror
from .mirror_interest import OutsideInterest
from .receipt import Receipt
from .transaction import Transaction
from .watch import Watch
from .watching import PoseEvent

__all__ = [
    "AsyncBatch",
    "AsyncBroadcaster",
    "AsyncGate",
    "AsyncMirror",
    "AsyncTransaction",
    "AsyncTransformClient",
    "AsyncWatch",
    "Batch",
    "Broadcaster",
    "Credentials",
    "Handle",
    "Mirror",
    "OutsideInterest",
    "PoseEvent",
    "Receipt",
    "Transaction",
    "TransformClient",
    "Watch",
    "__version__",
]
