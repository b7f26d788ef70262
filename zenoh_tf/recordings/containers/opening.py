"""Opens the files of a recording: what they are is what they begin with, not their names."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Final

from ...text.reasons import reason
from ..errors import RecordingError, missing_library
from .bag_file import BagFile
from .container import Choose, Container
from .db3_file import Db3File
from .decompress import ZSTD_MAGIC
from .mcap_file import McapFile

_MCAP: Final = b"\x89MCAP"
_ROS1_BAG: Final = b"#ROSBAG"
_SQLITE: Final = b"SQLite format 3\0"
#: The names of the files of a folder that are recordings.
_SUFFIXES: Final = (".mcap", ".db3", ".bag")
#: So much stays free in the folder of temporary files.
_FREE_BYTES: Final = 1 << 30
_PIECE_BYTES: Final = 1 << 20
#: A file that was compressed as a whole has at most this many times its size, and this in addition.
_RATIO, _LEEWAY_BYTES = 1000, 64 << 20


def open_all(path: Path, choose: Choose, stack: ExitStack) -> tuple[list[Container], list[str]]:
    """The files of a recording, in the order of their recording, and what is wrong with the rest.

    Args:
        path: A file, or a folder of files.
        choose: The channels that are read.
        stack: Closes them.

    Raises:
        RecordingError: None can be read.
    """
    if not path.exists():
        raise RecordingError(f"{path}: no such file")
    if not path.is_dir():
        return [_open(path, choose, stack)], []
    # Neither needs metadata.yaml: a recorder that was killed leaves none.
    files = sorted((each for each in path.iterdir() if _is_part(each)), key=_number_at_end)
    opened, faults = [], []
    for each in files:
        try:
            opened.append(_open(each, choose, stack))
        except RecordingError as error:
            faults.append(str(error))
    if not opened:
        raise RecordingError(
            faults[0]
            if faults
            else f"{path}: not a readable recording: the folder has no MCAP, db3 or bag file"
        )
    return opened, faults


def _open(path: Path, choose: Choose, stack: ExitStack) -> Container:
    try:
        found = _opener(path, choose, stack)()
    except RecordingError:
        raise
    except Exception as error:  # libraries raise any on damaged files
        raise RecordingError(f"{path}: not a readable recording: {reason(error)}") from error
    stack.callback(found.close)
    return found


def _opener(path: Path, choose: Choose, stack: ExitStack) -> Callable[[], Container]:
    with path.open("rb") as file:
        begin = file.read(len(_SQLITE))
    if not begin:
        raise RecordingError(f"{path}: the file is empty")
    if is_compressed := begin.startswith(ZSTD_MAGIC):
        begin = _content_begin(path)
    if begin.startswith(_MCAP):
        return lambda: McapFile(path, choose, compressed=is_compressed)
    if begin == _SQLITE:
        content = _decompressed(path, stack) if is_compressed else path
        return lambda: Db3File(content, choose, path)
    if begin.startswith(_ROS1_BAG):
        content = _decompressed(path, stack) if is_compressed else path
        return lambda: BagFile(content, choose)
    raise RecordingError(f"{path}: not a recording: neither MCAP, db3 nor a ROS 1 bag")


def _content_begin(path: Path) -> bytes:
    try:
        import zstandard  # noqa: PLC0415 - of the extra
    except ImportError as error:
        raise missing_library(error) from error
    with path.open("rb") as file, zstandard.ZstdDecompressor().stream_reader(file) as content:
        return content.read(len(_SQLITE))


def _decompressed(path: Path, stack: ExitStack) -> Path:
    """A temporary copy without compression, for files that are not read in their order."""
    import zstandard  # noqa: PLC0415 - of the extra

    folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
    free = shutil.disk_usage(folder).free - _FREE_BYTES
    likely = _RATIO * path.stat().st_size + _LEEWAY_BYTES
    allowed = min(free, likely)
    copy = folder / "content"
    with path.open("rb") as file, copy.open("wb") as out:
        content = zstandard.ZstdDecompressor().stream_reader(file, read_across_frames=True)
        while piece := content.read(_PIECE_BYTES):
            allowed -= len(piece)
            if allowed < 0 and likely <= free:
                raise RecordingError(
                    f"{path}: damaged: it has more than {likely:,} bytes before its compression"
                )
            if allowed < 0:
                raise RecordingError(
                    f"{path}: it does not fit into {folder.parent} without its compression; name "
                    "another folder by the environment variable TMPDIR"
                )
            out.write(piece)
    return copy


def _is_part(path: Path) -> bool:
    """Whether a file of a folder is one of the recording, and not compressed beside its content."""
    if path.suffix == ".zstd":
        return path.with_suffix("").suffix in _SUFFIXES and not path.with_suffix("").exists()
    return path.suffix in _SUFFIXES and path.is_file()


def _number_at_end(path: Path) -> tuple[int, str]:
    """The order of a folder's files: ``ros2 bag record`` ends their names with a number."""
    digits = path.name.partition(".")[0].rsplit("_", 1)[-1]
    return (int(digits) if digits.isdecimal() else 0, path.name)
