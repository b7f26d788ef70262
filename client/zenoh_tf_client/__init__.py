"""The client library of zenoh-tf: a synchronous and an asynchronous client, and their results."""

from importlib import import_module
from typing import TYPE_CHECKING

from zenoh_tf._net.credentials import Credentials

from .batch import Batch
from .client import TransformClient
from .publish.broadcaster import Broadcaster
from .requests.handle import Handle
from .requests.receipt import Receipt
from .transaction import Transaction

if TYPE_CHECKING:
    from zenoh_tf import __version__

    from .aio.batch import AsyncBatch
    from .aio.client import AsyncTransformClient
    from .aio.transaction import AsyncTransaction
    from .mirror.interest import OutsideInterest
    from .mirror.mirror import Mirror
    from .mirror.watch import Watch
    from .mirror.watching import PoseEvent
else:
    # What a program without asyncio or mirrors need not wait for.
    _LATER = {
        "AsyncBatch": "zenoh_tf_client.aio.batch",
        "AsyncTransaction": "zenoh_tf_client.aio.transaction",
        "AsyncTransformClient": "zenoh_tf_client.aio.client",
        "Mirror": "zenoh_tf_client.mirror.mirror",
        "OutsideInterest": "zenoh_tf_client.mirror.interest",
        "PoseEvent": "zenoh_tf_client.mirror.watching",
        "Watch": "zenoh_tf_client.mirror.watch",
        "__version__": "zenoh_tf",
    }

    def __getattr__(name: str) -> object:
        if name not in _LATER:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return getattr(import_module(_LATER[name]), name)


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
