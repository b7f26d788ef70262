"""How long a query of a large recording takes: `python -m bench.large_recording [--gb 10]`.

Makes an MCAP file as `ros2 bag record` does it by default: chunks without compression, with a
camera's images and 0.1 % of transforms in each. The images are zeros that the file system need not
store. Prints the time of `zenoh-tf query` and its memory.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import BinaryIO

from mcap.writer import CompressionType, Writer

from zenoh_tf._core import TransformRows
from zenoh_tf.ros2.cdr import encode_tf_message

_IMAGE_BYTES = 1_000_000
_PER_IMAGE = 8  # messages with one transform of 116 bytes
_BLOCK = 1 << 16


class _Sparse:
    """A file in which blocks of zeros are holes."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file

    def write(self, data: bytes) -> int:
        for at in range(0, len(data), _BLOCK):
            block = data[at : at + _BLOCK]
            if block.count(0) == len(block):
                self._file.seek(len(block), 1)
            else:
                self._file.write(block)
        return len(data)

    def tell(self) -> int:
        return self._file.tell()

    def flush(self) -> None:
        self._file.flush()


def make(path: Path, size: int, compression: CompressionType = CompressionType.NONE) -> int:
    """Make the file. Returns the number of its transforms.

    Args:
        path: Where; nothing may be there.
        size: Its bytes, about.
        compression: Of its chunks. A compressed file is much smaller.
    """
    image = bytes(_IMAGE_BYTES)
    with path.open("xb") as file:
        writer = Writer(_Sparse(file), chunk_size=_IMAGE_BYTES, compression=compression)  # type: ignore[arg-type]
        writer.start("ros2")
        schema = writer.register_schema("tf2_msgs/msg/TFMessage", "ros2msg", b"")
        tf = writer.register_channel("/tf", "cdr", schema)
        schema = writer.register_schema("sensor_msgs/msg/Image", "ros2msg", b"")
        camera = writer.register_channel("/camera", "cdr", schema)
        images = size // _IMAGE_BYTES
        for number in range(images * _PER_IMAGE):
            stamp_ns = 10**18 + number * 4_000_000
            row = ("map", "base", stamp_ns, (number / 1000, 0, 0, 0, 0, 0, 1))
            data = encode_tf_message(TransformRows.of_tuples([row]))
            writer.add_message(tf, stamp_ns, data, stamp_ns)
            if number % _PER_IMAGE == _PER_IMAGE - 1:
                writer.add_message(camera, stamp_ns, image, stamp_ns)
        writer.finish()  # type: ignore[no-untyped-call]
    return images * _PER_IMAGE


def main() -> None:
    """Make it, ask it, and print what that took."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--gb", type=float, default=10.0)
    parser.add_argument("--zstd", action="store_true", help="compress the chunks")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "large.mcap"
        compression = CompressionType.ZSTD if args.zstd else CompressionType.NONE
        count = make(path, int(args.gb * 1e9), compression)
        begin_s = time.monotonic()
        subprocess.run([sys.executable, "-m", "zenoh_tf_tools", "query", str(path)], check=True)
        spent_s = time.monotonic() - begin_s
        peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss // 1024
        size = path.stat().st_size / 1e9
        print(f"{size:.1f} GB with {count:,} transforms: {spent_s:.1f} s, {peak} MB at most")


if __name__ == "__main__":
    main()
