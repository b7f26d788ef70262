"""The rules of the source tree: what may be imported from outside, sizes and words."""

from __future__ import annotations

import ast
import re
import sys
from collections import Counter
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
    "lz4": "zenoh_tf",
    "mcap": "zenoh_tf",
    "mcap_protobuf": "zenoh_tf",
    "rich": "zenoh_tf_tools",
    "rosbags": "zenoh_tf",
    "scipy": "zenoh_tf",
    "shtab": "zenoh_tf_tools",
    "trimesh": "zenoh_tf_tools",  # viser brings it
    "viser": "zenoh_tf_tools",
    "websockets": "zenoh_tf_tools",  # viser brings it
    "xxhash": "zenoh_tf",
    "zstandard": "zenoh_tf",
}
SOURCES = ("zenoh_tf", "server", "client", "tests", "bench", "examples", "docker", "scripts")
#: Files of a folder, and those that have more, with the reason.
MAX_FILES = 15
LARGE_FOLDERS = {
    "client/zenoh_tf_client/tf2": "its files have the names of tf2_ros's, which scripts import",
    "docs/explanation/decisions": "one record for each decision",
    "docs/how-to": "one page for each task",
    "tests/field": "one file for each part of the product that reports are about",
    "zenoh_tf/core/commits": "one file for each step of a commit",
    "zenoh_tf": "one file for each class of the library",
}
MAX_LINES = 400
MAX_FUNCTION_LINES = 60
TREE = "zenoh_tf/core/tree_state.hpp"
#: The last three stand for programs that share no code with this project.
OWN_CONFIGURATION = ("zenoh_config.py", "peer.py", "protocol_client.py", "ros2_robot.py")
#: Words of our own, with the field's. Only those that no sentence needs.
PLAIN = {
    r"told|tells": "sent, reported, returned, published",
    r"taken not to": "assumed not to",
    r"makes? no sense": "is corrupt, is invalid",
    r"means? nothing": "is unspecified",
    r"anew|beg[ai]ns? again": "again, retry",
    r"signs? of life": "heartbeat",
    r"as ever": "nothing",
    r"believes?|in its right mind": "what is checked",
    r"go(es)? on|going on": "continues",
}
#: How a block begins that is part of a function, or has functions.
NO_FUNCTION = re.compile(
    r"(\} *)?(if|for|while|switch|do|else|try|catch|namespace|class|struct|enum)\b"
)
HEADLESS = re.compile(r"\b(for|of|by|to|from) who\b|(^|[.;:] |[#/*\"] *)Who(ever)? \w+s\b", re.M)


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


def folders(repository: Repository) -> Iterator[Violation]:
    """A folder of more than 15 files has more than one subject."""
    files = repository.files(".py", ".pyi", ".cpp", ".hpp", ".md")
    for folder, count in Counter(path.rpartition("/")[0] for path in files).items():
        if count > MAX_FILES and folder not in LARGE_FOLDERS:
            problem = f"has {count} files, of at most {MAX_FILES}: split it by subject"
            yield Violation(folder, 1, f"{problem}, or give the reason in LARGE_FOLDERS")


def functions(repository: Repository) -> Iterator[Violation]:
    """A function over 60 lines does more than one thing."""
    for path in repository.files(".py", ".cpp", ".hpp", under=SOURCES):
        text = repository.text(path)
        found = _python_functions(text) if path.endswith(".py") else _native_functions(text)
        for line, lines in found:
            if lines > MAX_FUNCTION_LINES:
                problem = f"is a function of {lines} lines, of at most {MAX_FUNCTION_LINES}"
                yield Violation(path, line, f"{problem}: split it")


def _python_functions(text: str) -> Iterator[tuple[int, int]]:
    """The first line of each function, and how many lines it has; without those in functions."""
    nodes: list[ast.AST] = [parsed(text)]
    while nodes:
        node = nodes.pop()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node.lineno, (node.end_lineno or node.lineno) - node.lineno + 1
        else:
            nodes += getattr(node, "body", ())


def _native_functions(text: str) -> Iterator[tuple[int, int]]:
    """As `_python_functions`, of C++ as clang-format writes it: a brace that ends a line is closed
    by one at the begin of a line, as far to the right as the first line of the statement."""
    blocks: list[tuple[int, int, str]] = []
    begin, indent, statement = 0, 0, ""
    for number, line in enumerate(text.splitlines(), 1):
        code = line.partition("//")[0].strip()
        column = len(line) - len(line.lstrip())
        if code.startswith("}"):
            while blocks and blocks[-1][1] > column:
                blocks.pop()
            if blocks and blocks[-1][1] == column:
                opened, _, head = blocks.pop()
                if "(" in head and not NO_FUNCTION.match(head):
                    yield opened, number - opened + 1
        if not begin:
            begin, indent, statement = number, column, ""
        statement = f"{statement} {code}".strip()
        if code.endswith("{"):
            blocks.append((begin, indent, statement))
        if not code or code.endswith(("{", "}", ";", ":")):
            begin = 0


def words(repository: Repository) -> Iterator[Violation]:
    """Sentences use the field's words, not those of `PLAIN`."""
    for path, number, found in _lines_with(repository, re.compile(rf"\b({'|'.join(PLAIN)})\b")):
        better = next(PLAIN[own] for own in PLAIN if re.fullmatch(own, found))
        yield Violation(path, number, f"{found!r}: write {better}")


def actors(repository: Repository) -> Iterator[Violation]:
    """Docs, comments and messages say "a reader" or "the caller", never a headless "who"."""
    for path, number, found in _lines_with(repository, HEADLESS):
        yield Violation(path, number, f"name the actor in place of {found!r}")


def _lines_with(repository: Repository, pattern: re.Pattern[str]) -> Iterator[tuple[str, int, str]]:
    """(path, line, text) wherever a pattern is found."""
    for path in repository.files(".py", ".pyi", ".cpp", ".hpp", ".md", ".yaml"):
        text = repository.text(path)
        for found in pattern.finditer(text) if path != "scripts/checks/source_rules.py" else ():
            yield path, text.count("\n", 0, found.start()) + 1, found[0]


def configurations(repository: Repository) -> Iterator[Violation]:
    """Zenoh's configurations are built in one file, so that its unsafe defaults are off."""
    for path in repository.files(".py", under=SOURCES):
        if not path.endswith(OWN_CONFIGURATION):
            for number, line in repository.lines(path):
                if "zenoh.Config" + "()" in line:
                    yield Violation(path, number, "build configurations in zenoh_config.py")


def lock_order(repository: Repository) -> Iterator[Violation]:
    """The table in tree_state.hpp has each header with a mutex; no other header has rules."""
    found = re.search(r"// Lock order.*?#pragma once", repository.text(TREE), re.S)
    table = found[0] if found else ""
    for path in repository.files(".hpp", under=["zenoh_tf/core"]):
        text, name = repository.text(path), path.removeprefix("zenoh_tf/core/")
        if name not in table and re.search(r"^ +(mutable )?std::mutex \w+;", text, re.M):
            yield repository.at(path, "std::mutex", f"add {name} to the lock order in {TREE}")
        lines = [*text.splitlines(), ""]
        for number, line in enumerate(lines[:-1], 1):
            is_rule = path != TREE and re.search("lock order|taken last", line, re.I)
            if is_rule and "see tree_state.hpp" not in f"{line} {lines[number]}":
                yield Violation(path, number, f"the lock order is in {TREE} alone")
