"""The shared library as other projects find and use it."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from tests.conftest import StartServer
from zenoh_tf import StampedTransform, Transform

ROOT = Path(__file__).resolve().parents[2]

# The library is compiled for itself, which takes minutes.
pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]


def run(*command: str | Path) -> str:
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_the_examples_use_an_installed_library(tmp_path: Path) -> None:
    output = run("sh", ROOT / "scripts/cpp_example.sh", tmp_path)
    assert "1000 cycles, 0 misses, distance 0.250 m" in output
    assert "1000 of 1000 points in the map, the last at x = 6.200 m" in output

    library = tmp_path / "lib/libzenoh_tf.so"
    assert library.resolve() != library  # a link to the one with its version
    dynamic = run("readelf", "--dynamic", library)
    assert "Library soname: [libzenoh_tf.so.0.1]" in dynamic
    symbols = [line.split()[2] for line in run("nm", "-D", "--defined-only", library).splitlines()]
    functions = [symbol for symbol in symbols if not symbol.startswith("ZENOH_TF_")]
    assert len(functions) > 20
    assert all(f.startswith("ztf_") and f.endswith("@@ZENOH_TF_0.1") for f in functions)

    if shutil.which("pkg-config"):
        package = tmp_path / "lib/pkgconfig/zenoh_tf.pc"
        flags = run("pkg-config", "--cflags", "--libs", package).split()
        assert flags == [f"-I{tmp_path}/include", f"-L{tmp_path}/lib", "-lzenoh_tf"]


def test_a_program_with_zenoh_pico_writes_to_a_server(
    start_sharing: StartServer, socket_folder: Path, tmp_path: Path
) -> None:
    run("sh", ROOT / "scripts/cpp_example.sh", tmp_path)
    pick = ROOT / "build/library/examples/pick"
    if not pick.exists():
        pytest.skip("zenoh-pico is not where CMake looks for packages")
    server = start_sharing()
    command: list[str | Path] = [pick, server.endpoint, socket_folder]
    with server.connect() as tf:
        tf.set_transform(StampedTransform("map", "gripper", 1, Transform((1, 2, 0))))
        refused = subprocess.run(command, check=False, capture_output=True, text=True)
        assert refused.returncode == 1
        assert refused.stderr.startswith("ZTF_LOOKUP: frame 'object' does not exist")
        tf.set_transform(StampedTransform("map", "object", 1, Transform((3, 2, 0))))
        assert run(*command) == "the gripper holds the object\n"
        held = tf.lookup_latest_transform("gripper", "object")
        assert held.transform.translation[0] == 2
        assert tf.parent("object") == "gripper"
