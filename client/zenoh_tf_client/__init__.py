"""The client library of zenoh-tf: `TransformClient.connect` and what it returns."""

from zenoh_tf import __version__
from zenoh_tf.credentials import Credentials

from .batch import Batch
from .broadcaster import Broadcaster
from .client import TransformClient
from .handle import Handle
from .mirror import Mirror
from .receipt import Receipt
from .transaction import Transaction

__all__ = [
    "Batch",
    "Broadcaster",
    "Credentials",
    "Handle",
    "Mirror",
    "Receipt",
    "Transaction",
    "TransformClient",
    "__version__",
]
