"""Prints the coverage of both languages, and the files of which the tests run least."""

from __future__ import annotations

import json
import sys
from pathlib import Path

SHOWN = 8


def show(what: str, files: dict[str, tuple[int, int]]) -> None:
    """`files`: lines that ran, and all lines, by file."""
    ran, lines = (sum(counts[i] for counts in files.values()) for i in (0, 1))
    print(f"{what}: {ran:,} of {lines:,} lines, {100 * ran / max(lines, 1):.1f} %. Least of:")
    by_share = sorted((ran / lines, name) for name, (ran, lines) in files.items() if lines)
    for share, name in by_share[:SHOWN]:
        print(f"  {100 * share:5.1f} %  {name}")


def main() -> None:
    folder = Path(sys.argv[1])
    python = json.loads((folder / "python.json").read_text())["files"]
    summaries = {name: found["summary"] for name, found in python.items()}
    show(
        "Python",
        {name: (one["covered_lines"], one["num_statements"]) for name, one in summaries.items()},
    )
    core = json.loads((folder / "core.json").read_text())["files"]
    show("C++", {one["filename"]: (one["line_covered"], one["line_total"]) for one in core})


if __name__ == "__main__":
    main()
