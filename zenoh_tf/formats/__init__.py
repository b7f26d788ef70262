"""Messages with transforms in formats of other projects, each in a file: bytes in, rows out.

`decoder_of` gives the decoder of a format that a server can ingest; recordings find
theirs by the schemas and encodings that their files name (`recordings/decoders.py`).
"""

from __future__ import annotations

from typing import Final

from . import foxglove, lcm
from .rows import Decode

#: What `zenoh-tf-server --ingest` knows, by name: each is a decoder of whole messages.
NAMES: Final = ("lcm", "foxglove", "foxglove-json", "foxglove-flatbuffer")


def decoder_of(name: str) -> Decode:
    """The decoder of a format in `NAMES`.

    Raises:
        ImportError: The extra `recordings`, which has the format's schemas, is not installed.
    """
    if name == "lcm":
        decode = lcm.decode
    else:
        encoding = name.partition("-")[2] or "protobuf"
        decode = foxglove.decoders("foxglove.FrameTransforms")[encoding]
    decode([b""])  # imports the schemas
    return decode
