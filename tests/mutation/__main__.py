"""``make mutants``: changes decisions of the core one by one, and expects a C++ test to fail.

mull does not install from PyPI or Debian, so the mutations are a list of our own (`core.py`): each
is one textual change of a decision. A copy of the core is built with it, and the C++ tests of the
decision's subject run until one fails. A mutant that survives is a decision that no C++ test
rests on; `core.py` says of each known one why that is right, or which other test finds it.

python -m tests.mutation                 all mutants
python -m tests.mutation walk replay     those of files with these words in their names
"""

from __future__ import annotations

import argparse
import os
import subprocess
from pathlib import Path

from .core import MUTANTS, Mutant

ROOT = Path(__file__).resolve().parents[2]
COPY = ROOT / "build/mutants"
BUILD = COPY / "build/core-plain"
#: A mutant may loop for ever.
TIMEOUT_S = 300


def prepare() -> None:
    """A copy of the core and its tests."""
    for folder in ("zenoh_tf/core", "tests/core", "tests/history"):
        _update(ROOT / folder, COPY / folder)
    compiler = subprocess.run(
        ["sh", ROOT / "scripts/compiler.sh"], stdout=subprocess.PIPE, text=True, check=True
    )
    os.environ["CXX"] = compiler.stdout.strip()
    subprocess.run(
        [
            *("cmake", "-S", COPY / "zenoh_tf/core", "-B", BUILD, "-G", "Ninja"),
            *("--log-level=WARNING", "-DZTF_BUILD_TESTS=ON", "-DZTF_WERROR=ON"),
            "-DZTF_SANITIZE=",
            "-DCMAKE_UNITY_BUILD_BATCH_SIZE=1",  # a mutant is one file
        ],
        check=True,
    )


def _update(source: Path, copy: Path) -> None:
    """Make a folder like another. What is equal keeps its time, and what a run that was cut off has
    left mutated gets a new one, so that the right objects are built again."""
    wanted = {path.relative_to(source) for path in source.rglob("*") if path.is_file()}
    for path in [each for each in copy.rglob("*") if each.is_file()]:
        if path.relative_to(copy) not in wanted:
            path.unlink()
    for name in wanted:
        content, target = (source / name).read_bytes(), copy / name
        if not target.exists() or target.read_bytes() != content:
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(content)


def build(*tests: str) -> None:
    subprocess.run(["cmake", "--build", BUILD, "--target", *tests, "--", "--quiet"], check=True)


def found_by(mutant: Mutant) -> str:
    """The test that finds it; "" if it survives. Raises CalledProcessError if it has no build."""
    path = COPY / "zenoh_tf/core" / mutant.file
    text = path.read_text()
    assert text.count(mutant.old) == 1, f"{mutant.file} has not one {mutant.old!r}: mend core.py"
    path.write_text(text.replace(mutant.old, mutant.new))
    try:
        for test in mutant.tests:
            build(test)
            if not _passes(test):
                return test
        return ""
    finally:
        path.write_text(text)


def _passes(test: str) -> bool:
    try:
        done = subprocess.run([BUILD / test], capture_output=True, timeout=TIMEOUT_S, check=False)
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description=__doc__)
    parser.add_argument("words", nargs="*", help="only mutants of files with these words")
    words = parser.parse_args().words
    os.environ["PATH"] = f"{ROOT / '.venv/bin'}:{os.environ['PATH']}"
    prepare()
    mutants = [each for each in MUTANTS if not words or any(word in each.file for word in words)]
    tests = sorted({test for each in mutants for test in each.tests})
    build(*tests)
    for test in tests:
        assert _passes(test), f"{test} fails without a mutation"
    found = unexplained = 0
    for mutant in mutants:
        try:
            test = found_by(mutant)
        except subprocess.CalledProcessError:
            unexplained += 1
            outcome = "DOES NOT BUILD: mend core.py"
        else:
            found += bool(test)
            unexplained += not test and not mutant.survives
            outcome = f"found by {test}" if test else f"SURVIVES {mutant.survives}"
        print(f"{mutant.file}: {mutant.what}: {outcome}", flush=True)
    print(f"{found} of {len(mutants)} mutants of the core were found")
    return 1 if unexplained else 0


if __name__ == "__main__":
    raise SystemExit(main())
