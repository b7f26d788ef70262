"""The rules of the source tree: what may be imported from outside, sizes and words."""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator

from .public_members import parsed
from .repository import Repository, Violation

PACKAGES = {
    "zenoh_tf": "zenoh_tf",
    "zenoh_tf_server": "server/zenoh_tf_server",
    "zenoh_tf_client": "client/zenoh_tf_client",
    "zenoh_tf_tools": "client/zenoh_tf_tools",
}
RUN_TIME = {"zenoh", "numpy", "msgpack", "uvloop"}
#: Optional imports: what an extra brings, and the one package that may use it.
EXTRAS = {
    "foxglove": "zenoh_tf_tools",
    "matplotlib": "zenoh_tf_tools",
    "prometheus_client": "zenoh_tf_server",
    "foxglove_schemas_protobuf": "zenoh_tf",
    "mcap": "zenoh_tf",
    "mcap_protobuf": "zenoh_tf",
    "rich": "zenoh_tf_tools",
    "rosbags": "zenoh_tf",
    "scipy": "zenoh_tf",
    "shtab": "zenoh_tf_tools",
    "viser": "zenoh_tf_tools",
    "xxhash": "zenoh_tf",
}
SOURCES = ("zenoh_tf", "server", "client", "tests", "bench", "examples", "docker", "scripts")
MAX_LINES = 400
TREE = "zenoh_tf/core/tree.hpp"
#: peer.py and ros2_robot.py stand for programs that share no code with this project.
OWN_CONFIGURATION = ("zenoh_config.py", "peer.py", "ros2_robot.py")
HEADLESS = re.compile(r"\b(for|of|by|to|from) who\b|(^|[.;:] |[#/*\"] *)Who(ever)? \w+s\b")


def imports(repository: Repository) -> Iterator[Violation]:
    """Only run-time dependencies are imported, and extras, which have one place each."""
    for package, folder in PACKAGES.items():
        for path in repository.files(".py", under=[folder]):
            for line, name in _imported(repository.text(path)):
                known = name in PACKAGES or name in sys.stdlib_module_names or name in RUN_TIME
                if not known and EXTRAS.get(name) != package:
                    problem = f"imports {name}, which is no run-time dependency; see EXTRAS"
                    yield Violation(path, line, problem)
        if not repository.exists(f"{folder}/py.typed"):
            yield Violation(f"{folder}/py.typed", 1, "is missing, so the package is not typed")


def _imported(text: str) -> Iterator[tuple[int, str]]:
    """Every top-level module that a file imports absolutely, with its line."""
    for node in ast.walk(parsed(text)):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            names = [node.module]
        for name in names:
            yield node.lineno, name.split(".")[0]  # type: ignore[attr-defined]


def sizes(repository: Repository) -> Iterator[Violation]:
    """A file over 400 lines has more than one subject."""
    for path in repository.files(".py", ".pyi", ".cpp", ".hpp", under=SOURCES):
        lines = len(repository.text(path).splitlines())
        if lines > MAX_LINES:
            problem = f"has {lines} lines, of at most {MAX_LINES}: split it by subject"
            yield Violation(path, MAX_LINES + 1, problem)


def actors(repository: Repository) -> Iterator[Violation]:
    """Docs, comments and messages say "a reader" or "the caller", never a headless "who"."""
    for path in repository.files(".py", ".pyi", ".cpp", ".hpp", ".md", ".yaml"):
        for number, line in repository.lines(path):
            if HEADLESS.search(line) and path != "scripts/checks/source_rules.py":
                yield Violation(path, number, f"name the actor: {line.strip()}")


def configurations(repository: Repository) -> Iterator[Violation]:
    """Zenoh's configurations are built in one file, so that its unsafe defaults are off."""
    for path in repository.files(".py", under=SOURCES):
        if not path.endswith(OWN_CONFIGURATION):
            for number, line in repository.lines(path):
                if "zenoh.Config" + "()" in line:
                    yield Violation(path, number, "build configurations in zenoh_config.py")


def lock_order(repository: Repository) -> Iterator[Violation]:
    """The table in tree.hpp has each header of the core with a mutex; no other header has rules."""
    found = re.search(r"// Lock order.*?#pragma once", repository.text(TREE), re.S)
    table = found[0] if found else ""
    for path in repository.files(".hpp", under=["zenoh_tf/core"]):
        text, name = repository.text(path), path.removeprefix("zenoh_tf/core/")
        if name not in table and re.search(r"^ +(mutable )?std::mutex \w+;", text, re.M):
            yield repository.at(path, "std::mutex", f"add {name} to the lock order in {TREE}")
        lines = [*text.splitlines(), ""]
        for number, line in enumerate(lines[:-1], 1):
            is_rule = path != TREE and re.search("lock order|taken last", line, re.I)
            if is_rule and "see tree.hpp" not in f"{line} {lines[number]}":
                yield Violation(path, number, f"the lock order is in {TREE} alone")
