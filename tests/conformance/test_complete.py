"""The suite itself: every rule has a test, none is skipped, and the docs state their number."""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
PAGE = FOLDER.parent.parent / "docs/from-tf2.md"

#: Group -> its last row; rows are numbered from 01.
LAST = {
    "A": 10,  # what a set rejects
    "B": 13,  # the history of one link
    "C": 9,  # static transforms
    "D": 10,  # trees of several shapes
    "E": 12,  # times
    "F": 8,  # errors
    "G": 5,  # introspection
    "H": 10,  # waiting
    "I": 6,  # velocity
    "J": 5,  # over the network
    "K": 10,  # applying transforms
}
ROWS = sorted([f"{group}{n:02}" for group, last in LAST.items() for n in range(1, last + 1)])
ROWS.insert(ROWS.index("A09"), "A08b")


def rows_tests() -> Iterator[tuple[Path, ast.FunctionDef]]:
    """The test functions of the rows."""
    for path in sorted(FOLDER.glob("test_?_*.py")):
        for node in ast.parse(path.read_text(), path).body:
            if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
                yield path, node


def row_of(path: Path, test: ast.FunctionDef) -> str:
    found = re.match(r"test_([A-K]\d\db?)_[a-z]", test.name)
    assert found, f"{path.name}: {test.name} is not named after a row"
    assert path.name.startswith(f"test_{found[1][0].lower()}_"), f"{test.name} in {path.name}"
    return found[1]


def test_every_row_has_one_test() -> None:
    count = Counter(row_of(path, test) for path, test in rows_tests())
    assert [row for row in ROWS if count[row] != 1] == []
    assert set(count) == set(ROWS)


def test_every_row_says_its_rule() -> None:
    assert [test.name for _, test in rows_tests() if not ast.get_docstring(test)] == []


def test_no_row_is_skipped() -> None:
    for path in sorted(FOLDER.glob("test_?_*.py")):
        for node in ast.walk(ast.parse(path.read_text(), path)):
            name = getattr(node, "attr", getattr(node, "id", ""))
            assert name not in {"skip", "skipif", "importorskip", "xfail"}, path.name


def test_the_page_knows_the_number_of_rows() -> None:
    assert f"the suite has {len(ROWS)} cases" in " ".join(PAGE.read_text().split()).lower()
