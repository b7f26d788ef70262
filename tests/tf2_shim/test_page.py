"""docs/from-tf2.md says what is so: its names exist, its commands and its script run."""

from __future__ import annotations

import ast
import inspect
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from zenoh_tf import StampedTransform, Transform, TransformTree
from zenoh_tf_client import TransformClient
from zenoh_tf_client.tf2 import FilterFailureReason

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs/from-tf2.md").read_text()
CODE = [code.strip() for code in re.findall(r"`([^`\n]+)`", PAGE)]
EXAMPLE = ROOT / "examples/from_tf2.py"
FILTER_EXAMPLE = ROOT / "examples/message_filter.py"


def run(*command: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *command], capture_output=True, text=True, timeout=50, check=False
    )


def test_the_example_runs(shared_server: Any) -> None:
    done = run(EXAMPLE, "--connect", shared_server.endpoint)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "base_link at Vector3(x=2.0, y=0.0, z=0.0)\n"


def test_the_example_of_a_filter_runs(shared_server: Any) -> None:
    done = run(FILTER_EXAMPLE, "--connect", shared_server.endpoint)
    assert (done.returncode, done.stderr) == (0, "")
    assert f"It prints\n\n```\n{done.stdout}```\n" in PAGE


@pytest.mark.parametrize("example", [EXAMPLE, FILTER_EXAMPLE])
def test_the_examples_are_short_and_on_the_page(example: Path) -> None:
    text = example.read_text()
    assert len(text.splitlines()) < 40
    assert f"```python\n{text}```" in PAGE


def test_every_reason_of_a_filter_is_on_the_page() -> None:
    assert all(f"`{reason.name}`" in PAGE for reason in FilterFailureReason)


def calls() -> Iterator[tuple[str, str, str]]:
    """(owner, method, arguments) of the page's calls on `tf` and `X`."""
    for code in CODE:
        yield from re.findall(r"\b(tf|X|Transform|TransformTree)\.(\w+)\(([^`]*)\)", code)


@pytest.mark.parametrize(
    ("owner", "method", "arguments"), sorted(set(calls())), ids=lambda part: str(part)[:20]
)
def test_every_method_exists(owner: str, method: str, arguments: str) -> None:
    kind = TransformClient if owner == "tf" else Transform
    function = getattr(kind, method)
    if owner == "tf":
        parameters = inspect.signature(function).parameters
        for name in re.findall(r"(\w+)=", arguments):
            assert name in parameters, (method, name)


def test_the_page_has_calls_to_check() -> None:
    assert len(set(calls())) > 25
    assert TransformTree(cache_time_s=10.0).frames() == []


IMPORTS = [code for code in CODE if "zenoh_tf_client.tf2" in code and "import" in code]


@pytest.mark.parametrize("line", IMPORTS)
def test_every_import_works(line: str) -> None:
    exec(line, {})


def test_the_page_has_imports_to_check() -> None:
    assert len(IMPORTS) == 6


COMMANDS = [code for code in CODE if code.startswith("zenoh-tf ")]


@pytest.mark.parametrize("command", sorted({*COMMANDS, "zenoh-tf frames --dot"}))
def test_every_command_runs(shared_server: Any, command: str) -> None:
    words = shlex.split(command)[1:]
    if words[0] in ("replay", "static"):  # a recording that is not here; a name without arguments
        words[1:] = ["--help"]
    if words[0] in ("echo", "monitor", "top"):  # they go on
        words += ["--count", "1"]
    with shared_server.connect() as tf:
        tf.set_transform(StampedTransform("map", "base_link", 1, Transform()), "wheels")
    done = run("-m", "zenoh_tf_client", "--connect", shared_server.endpoint, *words)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout


def test_every_difference_that_a_test_shows_is_on_the_page() -> None:
    named = set()
    for group, first, last in re.findall(r"\b([A-M])(\d\d)(?: to [A-M](\d\d))?", PAGE):
        for number in range(int(first), int(last or first) + 1):
            named.add(f"{group}{number:02}")
    shown = set()
    for path in (ROOT / "tests/conformance").glob("test_?_*.py"):
        for node in ast.parse(path.read_text(), path).body:
            if isinstance(node, ast.FunctionDef) and "[Q]" in (ast.get_docstring(node) or ""):
                shown.add(node.name.split("_")[1][:3])
    assert len(shown) > 10
    assert shown - named == set()
