"""Where this installation has `libzenoh_tf`, for builds of programs in C and C++.

``python -m zenoh_tf.native --cmakedir`` (or ``--cflags``, ``--libs``) prints it for a build script.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from zenoh_tf import _core

# Beside the native module, which an editable installation has in another folder than this file.
_FOLDER = Path(_core.__file__).parent / "_native"


def library() -> Path:
    """Return the shared library's path, for ``ctypes`` and the like."""
    for path in (_FOLDER / "lib").glob("libzenoh_tf.so.*"):
        return path
    raise FileNotFoundError(f"no libzenoh_tf in {_FOLDER}: it is built on Linux only")


def cmakedir() -> Path:
    """Return the folder of the CMake package, for ``zenoh_tf_DIR``."""
    return _FOLDER / "lib/cmake/zenoh_tf"


def cflags() -> str:
    """Return the compiler's flags."""
    return f"-I{_FOLDER / 'include'}"


def libs() -> str:
    """Return the linker's flags, with which a program also finds the library when it runs."""
    path = library()
    return f"-L{path.parent} -Wl,-rpath,{path.parent} -l:{path.name}"


def main(arguments: list[str] | None = None) -> None:
    """Print what the flags ask for, a line for each."""
    parser = argparse.ArgumentParser(prog="python -m zenoh_tf.native", description=__doc__)
    for answer in (cmakedir, cflags, libs, library):
        parser.add_argument(
            f"--{answer.__name__}",
            dest="answers",
            action="append_const",
            const=answer,
            help=(answer.__doc__ or "").replace("Return", "print", 1),
        )
    answers = parser.parse_args(arguments).answers
    if not answers:
        parser.error("name at least one flag")
    for answer in answers:
        print(answer())


if __name__ == "__main__":
    main()
