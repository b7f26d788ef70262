"""The rules of the source tree itself: which way imports point, what may be depended on."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = {
    "zenoh_tf": ROOT / "zenoh_tf",
    "zenoh_tf_server": ROOT / "server/zenoh_tf_server",
    "zenoh_tf_client": ROOT / "client/zenoh_tf_client",
}
RUN_TIME = {"zenoh", "numpy", "msgpack", "uvloop"}
#: Optional imports: what an extra brings, and the one package that may use it.
EXTRAS = {
    "cryptography": "zenoh_tf_client",
    "prometheus_client": "zenoh_tf_server",
    "foxglove_schemas_protobuf": "zenoh_tf",
    "mcap": "zenoh_tf",
    "mcap_protobuf": "zenoh_tf",
    "rich": "zenoh_tf_client",
    "rosbags": "zenoh_tf",
    "scipy": "zenoh_tf",
    "shtab": "zenoh_tf_client",
    "xxhash": "zenoh_tf",
}


def _imports(package: str) -> Iterator[tuple[Path, str]]:
    """Every top-level module that a package's files import absolutely."""
    for path in sorted(PACKAGES[package].rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(), path)):
            names: list[str] = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
                names = [node.module]
            for name in names:
                yield path, name.split(".")[0]


@pytest.mark.parametrize("package", PACKAGES)
def test_imports_point_one_way(package: str) -> None:
    allowed = {package, "zenoh_tf"}
    for path, name in _imports(package):
        if name in PACKAGES:
            assert name in allowed, f"{path} imports {name}"


@pytest.mark.parametrize("package", PACKAGES)
def test_nothing_but_the_run_time_dependencies_is_imported(package: str) -> None:
    for path, name in _imports(package):
        if name in PACKAGES or name in sys.stdlib_module_names or name in RUN_TIME:
            continue
        assert EXTRAS.get(name) == package, f"{path} imports {name}"


@pytest.mark.parametrize("package", PACKAGES)
def test_packages_are_typed(package: str) -> None:
    assert (PACKAGES[package] / "py.typed").is_file()


def test_files_stay_short() -> None:
    """A file over 400 lines has more than one subject."""
    folders = ["zenoh_tf", "server", "client", "tests", "bench", "examples", "docker"]
    for folder in folders:
        for path in (ROOT / folder).rglob("*"):
            if path.suffix in {".py", ".pyi", ".cpp", ".hpp"}:
                lines = len(path.read_text().splitlines())
                assert lines <= 400, f"{path.relative_to(ROOT)} has {lines} lines"


def test_the_changelog_knows_the_version() -> None:
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert version in (ROOT / "CHANGELOG.md").read_text()


def test_sentences_name_their_actor() -> None:
    """Docs, comments and messages say "a reader" or "the caller", never a headless "who"."""
    headless = re.compile(r"\b(for|of|by|to|from) who\b|(^|[.;:] |[#/*\"] *)Who(ever)? \w+s\b")
    folders = ["zenoh_tf", "server", "client", "tests", "bench", "examples", "docker", "docs"]
    suffixes = {".py", ".pyi", ".cpp", ".hpp", ".md", ".yaml"}
    for path in (path for folder in folders for path in (ROOT / folder).rglob("*")):
        if path.suffix not in suffixes or path == Path(__file__):
            continue
        for number, line in enumerate(path.read_text().splitlines(), 1):
            assert not headless.search(line), f"{path.relative_to(ROOT)}:{number}: {line.strip()}"
