"""The conformance suite: each row of tf2's behaviour has one test, and the docs know them."""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Iterator

from .public_members import parsed
from .repository import Repository, Violation

PAGE = "docs/how-to/from-tf2.md"
FOLDER = "tests/conformance"
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
ROWS = {f"{group}{n:02}" for group, last in LAST.items() for n in range(1, last + 1)} | {"A08b"}
SKIPS = {"skip", "skipif", "importorskip", "xfail"}


def conformance(repository: Repository) -> Iterator[Violation]:
    """Every row has one test with its rule, none is skipped, and the page has the differences."""
    count: Counter[str] = Counter()
    named = set(_rows_on_the_page(repository.text(PAGE)))
    for path in repository.files(".py", under=[FOLDER]):
        if not re.search(r"/test_[a-z]_\w+\.py$", path):
            continue
        tree = parsed(repository.text(path))
        for node in tree.body:
            if not isinstance(node, ast.FunctionDef) or not node.name.startswith("test_"):
                continue
            found = re.match(r"test_([A-Z]\d\db?)_[a-z]", node.name)
            if not found or f"/test_{found[1][0].lower()}_" not in path:
                yield Violation(path, node.lineno, f"name {node.name} after a row of this group")
                continue
            count[found[1]] += 1
            doc = ast.get_docstring(node)
            if not doc:
                yield Violation(path, node.lineno, f"{node.name}: say the rule in a docstring")
            elif "[Q]" in doc and found[1][:3] not in named:
                problem = f"{found[1]} differs from tf2: explain it in {PAGE}"
                yield Violation(path, node.lineno, problem)
        for part in ast.walk(tree):
            if getattr(part, "attr", getattr(part, "id", "")) in SKIPS:
                line = getattr(part, "lineno", 1)
                yield Violation(path, line, "no row may be skipped")
    for row in sorted(ROWS | count.keys()):
        if row not in ROWS or count[row] != 1:
            yield Violation(FOLDER, 1, f"row {row} has {count[row]} tests; see LAST")
    if f"the suite has {len(ROWS)} cases" not in " ".join(repository.text(PAGE).split()).lower():
        yield repository.at(PAGE, "The suite has", f"the suite has {len(ROWS)} cases")


def _rows_on_the_page(text: str) -> Iterator[str]:
    for group, first, last in re.findall(r"\b([A-M])(\d\d)(?: to [A-M](\d\d))?", text):
        for number in range(int(first), int(last or first) + 1):
            yield f"{group}{number:02}"
