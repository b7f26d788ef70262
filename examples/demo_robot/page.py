"""The demo's output: headings, prose and small tables, with colours on a terminal."""

from __future__ import annotations

import os
import sys
import textwrap
from collections.abc import Sequence

WIDTH = 78
_COLOUR = sys.stdout.isatty() and not os.environ.get("NO_COLOR")


def strong(text: str) -> str:
    return f"\x1b[1m{text}\x1b[0m" if _COLOUR else text


def faint(text: str) -> str:
    return f"\x1b[2m{text}\x1b[0m" if _COLOUR else text


def good(text: str) -> str:
    return f"\x1b[1;32m{text}\x1b[0m" if _COLOUR else text


def heading(text: str) -> None:
    line = "─" * (WIDTH - len(text) - 4)
    print(f"{faint('──')} {strong(text)} {faint(line)}")


def prose(text: str) -> None:
    for line in textwrap.wrap(" ".join(text.split()), WIDTH - 2):
        print(f"  {line}")
    print(flush=True)


def table(rows: Sequence[Sequence[str]]) -> None:
    """Print a table. The first row is the header; only the first column is left-aligned."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    for number, row in enumerate(rows):
        cells = [row[0].ljust(widths[0])]
        cells += [cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True)]
        line = "   ".join(cells)
        print("    " + (faint(line) if number == 0 else line))
    print(flush=True)
