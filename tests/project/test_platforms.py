"""What ``make platforms`` says of missing tools and of failures; the tools are stand-ins."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
NEEDED = ["bash", "sh", "dirname", "uname", "head", "tail", "sort", "grep", "mkdir", "nice", "cat"]
#: Answers --version, and accepts every program that scripts/compiler.sh lets it compile.
COMPILER = "#!/bin/sh\n[ $1 != --version ] || echo a stand-in\n"
CTEST = """#!/bin/sh
case "$*" in *{broken}*) echo a broken test; exit 8 ;; esac
echo "1/1 Test #1: test_pose ...   Passed   0.01 sec"
"""


@pytest.fixture
def run(tmp_path: Path):
    """``run(broken)``: the script where GCC 11 is the second compiler and nothing else is there."""
    scripts, tools = tmp_path / "scripts", tmp_path / "tools"
    shutil.copytree(ROOT / "scripts", scripts)
    tools.mkdir()
    for name in NEEDED:
        (tools / name).symlink_to(shutil.which(name) or name)

    def _run(broken: str) -> subprocess.CompletedProcess[str]:
        programs = {"c++": COMPILER, "g++-11": COMPILER, "cmake": "#!/bin/sh\n"}
        for name, text in {**programs, "ctest": CTEST.format(broken=broken)}.items():
            (tools / name).write_text(text)
            (tools / name).chmod(0o755)
        return subprocess.run(
            ["bash", scripts / "platforms.sh"],
            env={"PATH": str(tools)},
            capture_output=True,
            text=True,
            check=False,
        )

    return _run


def test_missing_tools_are_named_with_their_packages_and_are_no_failure(run) -> None:
    result = run(broken="nothing")
    assert result.returncode == 0, result.stdout + result.stderr
    assert result.stdout.count("passed: 1 test programs") == 2
    assert "clang++ is missing (Debian, Ubuntu: apt-get install clang)" in result.stdout
    assert "skipped: no clang++" in result.stdout


def test_a_failed_platform_fails_the_run_and_shows_its_log(run) -> None:
    result = run(broken="gcc-11")
    assert result.returncode == 1
    assert "a broken test" in result.stdout
    assert "FAILED: see build/platforms/gcc-11.log" in result.stdout
    assert result.stdout.count("passed: 1 test programs") == 1
