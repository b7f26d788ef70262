"""The library in an installation of the Python package, as other builds find it."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from zenoh_tf import native

PROGRAM = """
#include <stdio.h>
#include <zenoh_tf/zenoh_tf.h>
int main(void) { return puts(ztf_version()) < 0; }
"""


def run(*command: str | Path, **environment: str) -> str:
    done = subprocess.run(
        command, check=False, capture_output=True, text=True, env={**os.environ, **environment}
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def ask(*flags: str) -> list[str]:
    return run(sys.executable, "-m", "zenoh_tf.native", *flags).splitlines()


@pytest.fixture
def source(tmp_path: Path) -> Path:
    if not shutil.which("cc"):
        pytest.skip("needs a C compiler")
    path = tmp_path / "version.c"
    path.write_text(PROGRAM)
    return path


def test_the_flags_build_a_program_that_runs(source: Path) -> None:
    cflags, libs = ask("--cflags", "--libs")
    program = source.with_suffix("")
    run("cc", *cflags.split(), source, *libs.split(), "-o", program)
    assert run(program) == "0.1.0\n"


def test_the_folder_is_found_after_a_move(source: Path) -> None:
    """CMake's package and pkg-config's file name no folder of the build."""
    (cmakedir,) = ask("--cmakedir")
    moved = source.parent / "moved/zenoh_tf/_native"
    shutil.copytree(Path(cmakedir).parents[2], moved)
    if shutil.which("pkg-config"):
        folder = str(moved / "lib/pkgconfig")
        flags = run("pkg-config", "--cflags", "--libs", "zenoh_tf", PKG_CONFIG_PATH=folder).split()
        program = source.parent / "by_pkg_config"
        run("cc", source, *flags, "-o", program)
        assert str(moved.resolve()) in run("ldd", program).replace("lib/pkgconfig/../../../../", "")
        assert run(program) == "0.1.0\n"
    source.with_name("CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.16)\nproject(outside LANGUAGES C)\n"
        "find_package(zenoh_tf 0.1 REQUIRED)\nadd_executable(by_cmake version.c)\n"
        "target_link_libraries(by_cmake PRIVATE zenoh_tf::zenoh_tf)\n"
    )
    cmake = Path(sys.executable).with_name("cmake")
    build = source.parent / "build"
    package = f"-Dzenoh_tf_DIR={moved / 'lib/cmake/zenoh_tf'}"
    run(cmake, "-S", source.parent, "-B", build, package)
    run(cmake, "--build", build)
    assert str(moved) in run("ldd", build / "by_cmake")
    assert run(build / "by_cmake") == "0.1.0\n"


def test_ctypes_loads_it() -> None:
    (path,) = ask("--library")
    assert path == str(native.library())
    version = ctypes.CDLL(path).ztf_version
    version.restype = ctypes.c_char_p
    assert version() == b"0.1.0"


def test_without_a_flag_it_says_how() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "zenoh_tf.native"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert "--cmakedir" in done.stderr
