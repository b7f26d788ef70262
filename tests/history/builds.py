"""Builds the history driver with the core as it is, or with a fault patched into a copy."""

from __future__ import annotations

import os
import shutil
import subprocess
import sysconfig
from pathlib import Path

from .faults import Fault

ROOT = Path(__file__).resolve().parents[2]
CORE = ROOT / "zenoh_tf/core"
TOOLS = sysconfig.get_path("scripts")  # cmake and ninja come from PyPI


def build_driver() -> Path:
    """Build into the folder of the C++ tests, with the settings of scripts/core_test.sh."""
    settings = ("-DZTF_BUILD_LIBRARY=ON", "-DZTF_WERROR=ON", "-DZTF_SANITIZE=")
    return _build(CORE, ROOT / "build/core-plain", *settings)


def faulty_text(fault: Fault) -> str:
    text = (CORE / fault.file).read_text()
    found = text.count(fault.old)
    assert found == 1, f"{fault.name}: {fault.file} has the text {found} times"
    return text.replace(fault.old, fault.new)


def build_faulty_driver(fault: Fault) -> Path:
    """Build from a patched copy, as one file with little optimisation, which takes seconds."""
    folder = ROOT / "build/histories" / fault.name.replace(" ", "-")
    copy = folder / "zenoh_tf/core"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(CORE, copy)
    (folder / "tests").symlink_to(ROOT / "tests")
    (copy / fault.file).write_text(faulty_text(fault))
    return _build(
        copy,
        folder / "build",
        "-DCMAKE_UNITY_BUILD=ON",
        "-DCMAKE_UNITY_BUILD_BATCH_SIZE=0",
        "-DCMAKE_BUILD_TYPE=None",
        "-DCMAKE_CXX_FLAGS=-O1 -w",
    )


def compile_as_one_file(folder: Path) -> str:
    """Compile the core as faulty ones are built, without making code; return the errors."""
    one = folder / "core.cpp"
    one.write_text("".join(f'#include "{path}"\n' for path in sorted(CORE.rglob("*.cpp"))))
    flags = ("-std=c++20", "-fsyntax-only", "-w", f"-I{CORE}", f"-I{ROOT / 'tests/core'}")
    command = [_compiler(), *flags, "-DZTF_YIELDS", str(one)]
    return subprocess.run(command, check=False, capture_output=True, text=True).stderr


def _compiler() -> str:
    return subprocess.run(
        ["sh", ROOT / "scripts/compiler.sh"], check=True, capture_output=True, text=True
    ).stdout.strip()


def _build(source: Path, folder: Path, *settings: str) -> Path:
    path = f"{TOOLS}{os.pathsep}{os.environ['PATH']}"
    configure = ["cmake", "-S", str(source), "-B", str(folder), "-G", "Ninja"]
    configure += [
        "--log-level=WARNING",
        "-DZTF_BUILD_TESTS=ON",
        *settings,
    ]
    for command in (configure, ["cmake", "--build", str(folder), "--target", "history_driver"]):
        done = subprocess.run(
            command,
            check=False,
            env={**os.environ, "PATH": path, "CXX": _compiler()},
            capture_output=True,
            text=True,
            timeout=300,
        )
        assert done.returncode == 0, done.stdout + done.stderr
    return folder / "history_driver"
