"""No test fails because the machine is slow."""

from __future__ import annotations

import ast
from collections.abc import Iterator

from .public_members import parsed
from .repository import Repository, Violation

CLOCKS = {"monotonic", "monotonic_ns", "perf_counter", "perf_counter_ns", "time", "time_ns"}
#: It ends with a report that nothing moves any more.
MAY = {"tests/chaos/run.py"}


def clocks(repository: Repository) -> Iterator[Violation]:
    """No assertion bounds the time that something took from above.

    A deadline in a loop that waits is allowed, and a lower bound, which load cannot break.
    """
    for path in repository.files(".py", under=["tests"]):
        for node in ast.walk(parsed(repository.text(path))):
            if isinstance(node, ast.Assert) and path not in MAY and _bounds_a_duration(node.test):
                problem = "compare counts, or use a time-out beyond the test's, instead of a clock"
                yield Violation(path, node.lineno, problem)


def _bounds_a_duration(test: ast.expr) -> bool:
    """True for ``time.monotonic() - begin < 5`` and ``5 > time.monotonic() - begin``."""
    for compare in (node for node in ast.walk(test) if isinstance(node, ast.Compare)):
        sides = [compare.left, *compare.comparators]
        for left, operator, right in zip(sides, compare.ops, sides[1:], strict=False):
            small = left if isinstance(operator, ast.Lt | ast.LtE) else right
            if isinstance(operator, ast.Lt | ast.LtE | ast.Gt | ast.GtE) and _is_duration(small):
                return True
    return False


def _is_duration(expression: ast.expr) -> bool:
    return (
        isinstance(expression, ast.BinOp)
        and isinstance(expression.op, ast.Sub)
        and isinstance(expression.left, ast.Call)
        and isinstance(expression.left.func, ast.Attribute)
        and ast.unparse(expression.left.func.value) == "time"
        and expression.left.func.attr in CLOCKS
    )
