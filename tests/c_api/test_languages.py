"""Other languages over the C interface: the crate in examples/rust, and ctypes as on the page."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from zenoh_tf import native

ROOT = Path(__file__).resolve().parents[2]


def test_the_crate_passes_its_tests(tmp_path: Path) -> None:
    cargo = shutil.which("cargo")
    if cargo is None:
        pytest.skip("needs cargo")
    command = [cargo, "test", "--offline", "--locked", "--target-dir", str(tmp_path)]
    environment = {**os.environ, "ZENOH_TF_LIBRARY": str(native.library())}
    done = subprocess.run(
        command,
        cwd=ROOT / "examples/rust",
        env={**environment, "RUSTFLAGS": "-D warnings"},
        check=False,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "test result: ok. 4 passed" in done.stdout


def test_ctypes_as_the_page_shows(capsys: pytest.CaptureFixture[str]) -> None:
    page = (ROOT / "docs/how-to/cpp.md").read_text()
    (code,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    exec(compile(code, "docs/how-to/cpp.md", "exec"), {})
    assert capsys.readouterr().out == "0.5 500\nZTF_LOOKUP\n"
