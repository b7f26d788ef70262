"""Every example runs against a real server, and the README shows them as they are."""

from __future__ import annotations

import re
import subprocess
import sys
import time
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import zenoh_tf
import zenoh_tf_client
from zenoh_tf_client import TransformClient

ROOT = Path(__file__).resolve().parent.parent
EXAMPLES = ROOT / "examples"


def run(name: str, endpoint: str) -> str:
    done = subprocess.run(
        [sys.executable, EXAMPLES / name, "--connect", endpoint],
        capture_output=True,
        text=True,
        timeout=50,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_sensor_and_client(server: Any) -> None:
    sensor = subprocess.Popen(
        [sys.executable, EXAMPLES / "sensor.py", "--connect", server.endpoint]
    )
    try:
        with TransformClient.connect(server.endpoint) as tf:
            while not tf.can_transform("map", "camera"):
                assert sensor.poll() is None
                time.sleep(0.05)
            since_ns = tf.lookup_transform("map", "camera").stamp_ns  # the start may take long
            while not tf.can_transform("map", "camera", since_ns + 10**9):
                assert sensor.poll() is None
                time.sleep(0.05)
        lines = run("client.py", server.endpoint).splitlines()
    finally:
        sensor.terminate()
        sensor.wait(10)
    assert [line.split(":")[0] for line in lines] == [
        "now",
        "a quarter of a second before",
        "moved",
    ]
    now, then, moved = (_numbers(line) for line in lines)
    assert now[0] > then[0]
    assert now[1:] == [0.0, 0.5]  # the static link
    assert moved[0] == pytest.approx(now[0] - then[0], abs=1e-6)


def test_transaction(server: Any) -> None:
    assert _numbers(run("transaction.py", server.endpoint)) == pytest.approx([0.0, 0.0, 0.3])


def test_async_client(server: Any) -> None:
    lines = run("async_client.py", server.endpoint).splitlines()
    assert lines == ["wheels: 0.0 1.0 2.0 3.0", "the last: 3.0"]


def _numbers(line: str) -> list[float]:
    return [float(number) for number in re.findall(r"-?\d+\.?\d*(?:e-?\d+)?", line)]


@pytest.mark.parametrize(
    ("name", "page"),
    [
        ("sensor.py", "README.md"),
        ("client.py", "README.md"),
        ("transaction.py", "README.md"),
        ("async_client.py", "docs/asyncio.md"),
    ],
)
def test_examples_are_short_and_shown(name: str, page: str) -> None:
    text = (EXAMPLES / name).read_text()
    assert len(text.splitlines()) < 40
    assert f"```python\n{text}```" in (ROOT / page).read_text()


@pytest.mark.parametrize("page", ["architecture.md", "concurrency.md", "glossary.md"])
def test_pages_name_files_that_exist(page: str) -> None:
    files = [str(path) for path in ROOT.glob("*/**/*.*") if ".venv" not in path.parts]
    names = set(re.findall(r"[\w/]+\.(?:pyi?|hpp|cpp)\b", (ROOT / "docs" / page).read_text()))
    assert names
    assert [name for name in sorted(names) if not any(f.endswith(f"/{name}") for f in files)] == []


@pytest.mark.parametrize("package", [zenoh_tf, zenoh_tf_client])
def test_every_public_name_is_in_the_api_reference(package: ModuleType) -> None:
    pages = "".join(path.read_text() for path in (ROOT / "docs/api").glob("*.md"))
    shown = set(re.findall(r"^::: (\S+)$", pages, re.MULTILINE))
    for name in package.__all__:
        if not name.startswith("_") and not hasattr(zenoh_tf.errors, name):
            assert f"{package.__name__}.{name}" in shown


PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "bench/README.md",
    *(ROOT / "docs").glob("**/*.md"),
]


@pytest.mark.parametrize("page", [str(path.relative_to(ROOT)) for path in PAGES])
def test_links_lead_somewhere(page: str) -> None:
    text = (ROOT / page).read_text()
    for target in re.findall(r"\]\(([^)#]+?)(?:#[^)]*)?\)", text) + re.findall(
        r'src="([^"]+)"', text
    ):
        if "://" not in target:
            assert (ROOT / page).parent.joinpath(target).exists(), target
