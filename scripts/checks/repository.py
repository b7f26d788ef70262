"""The repository as the checks read it: texts of files, and where a violation is."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
#: Where source files and pages are.
FOLDERS = (
    *("zenoh_tf", "server", "client", "tests", "bench", "examples", "docker", "docs"),
    *("scripts", ".github", ".ci"),
)


@dataclass(frozen=True)
class Violation:
    """A place that breaks a rule, and how it is mended."""

    path: str
    line: int
    problem: str

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.problem}"


class Repository:
    """The files under `ROOT`.

    Args:
        changes: Text by path that replaces a file's own, or adds a file; None removes one. The
            self-test plants violations with it.
    """

    def __init__(self, changes: Mapping[str, str | None] | None = None) -> None:
        self._changes = dict(changes or {})

    def text(self, path: str) -> str:
        """The text of a file, by its path under `ROOT`; empty if there is none."""
        if path in self._changes:
            return self._changes[path] or ""
        return _read(path)

    def exists(self, path: str) -> bool:
        """True for a file or a folder."""
        if path in self._changes:
            return self._changes[path] is not None
        return (ROOT / path).exists()

    def files(self, *suffixes: str, under: Iterable[str] = FOLDERS) -> list[str]:
        """The paths of all files with one of the suffixes in these folders."""
        folders = tuple(f"{folder.rstrip('/')}/" for folder in under)
        found = {path for path in _all_files() if path.startswith(folders)}
        for path, text in self._changes.items():
            if path.startswith(folders):
                (found.discard if text is None else found.add)(path)
        return sorted(path for path in found if path.endswith(suffixes))

    def pages(self) -> list[str]:
        """The pages of the documentation."""
        outside = ["README.md", "CONTRIBUTING.md", "SECURITY.md", "bench/README.md"]
        return [
            *(page for page in outside if self.exists(page)),
            *self.files(".md", under=["docs"]),
        ]

    def lines(self, path: str) -> Iterator[tuple[int, str]]:
        """Each line with its number."""
        return enumerate(self.text(path).splitlines(), 1)

    def line_of(self, path: str, part: str) -> int:
        """The number of the first line that contains `part`, or 1."""
        before, found, _ = self.text(path).partition(part)
        return before.count("\n") + 1 if found else 1

    def at(self, path: str, part: str, problem: str) -> Violation:
        """A violation where `part` is first found in a file."""
        return Violation(path, self.line_of(path, part), problem)


@functools.cache
def _read(path: str) -> str:
    file = ROOT / path
    return file.read_text() if file.is_file() else ""


@functools.cache
def _all_files() -> frozenset[str]:
    found = (path for folder in FOLDERS for path in (ROOT / folder).rglob("*"))
    return frozenset(
        str(path.relative_to(ROOT))
        for path in found
        if path.is_file() and "__pycache__" not in path.parts
    )
