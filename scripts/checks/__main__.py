"""Rules that no compiler and no linter knows: ``python -m scripts.checks``, part of ``make lint``.

Prints each violation with its file and line, and ends with status 1 if there is one. Each function
in `CHECKS` has a planted violation in ``tests/project/test_checks.py`` that it must find.
"""

from __future__ import annotations

from . import CHECKS
from .repository import Repository


def main() -> int:
    repository = Repository()
    found = [violation for check in CHECKS for violation in check(repository)]
    for violation in sorted({str(violation) for violation in found}):
        print(violation)
    if found:
        print(f"{len(found)} violations of scripts/checks")
    return 1 if found else 0


if __name__ == "__main__":
    raise SystemExit(main())
