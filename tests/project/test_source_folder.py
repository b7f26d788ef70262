"""A checkout in which the installed package is hidden by its own sources."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import zenoh_tf


@pytest.mark.parametrize("program", ["import zenoh_tf", "from zenoh_tf.errors import BY_CODE"])
def test_sources_without_the_native_module_say_so(tmp_path: Path, program: str) -> None:
    """Without site-packages, where the native module of this checkout is."""
    folder = tmp_path / "zenoh_tf"
    folder.mkdir()
    (folder / "__init__.py").write_text(Path(zenoh_tf.__file__).read_text("utf-8"), "utf-8")
    done = subprocess.run(
        [sys.executable, "-S", "-c", program],
        cwd=tmp_path,
        env={},
        capture_output=True,
        text=True,
        check=False,
    )
    last = done.stderr.splitlines()[-1]
    assert last.startswith(f"ImportError: {folder} is a folder of zenoh-tf's sources")
    assert "make native" in last and "-P" in last
