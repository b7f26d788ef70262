"""The client library of zenoh-tf: a synchronous and an asynchronous client, and their results."""

from zenoh_tf import __version__
from zenoh_tf._net.credentials import Credentials

from .aio.batch import AsyncBatch
from .aio.client import AsyncTransformClient
from .aio.transaction import AsyncTransaction
from .batch import Batch
from .client import TransformClient
from .mirror.interest import OutsideInterest
from .mirror.mirror import Mirror
from .mirror.watch import Watch
from .mirror.watching import PoseEvent
from .publish.broadcaster import Broadcaster
from .requests.handle import Handle
from .requests.receipt import Receipt
from .transaction import Transaction

__all__ = [
    "AsyncBatch",
    "AsyncTransaction",
    "AsyncTransformClient",
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
