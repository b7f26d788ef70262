"""The kept results, and the documentation's measured numbers, which ``make lint`` compares.

In a page, ``<!-- bench:KEY -->20.6<!-- / -->`` holds a number; readers see only 20.6. KEY is a
path: a part, the labels of a row and a metric, or a part and the name of a target. It may end in
``;M`` for millions, or ``;range`` for the quartiles as well. A marker must not begin a line, unless
the line has nothing else.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from bench.machine import ROOT, changed_since

FOLDER = ROOT / "bench/results"
MARKER = re.compile(r"(<!-- bench:(?P<key>.+?) -->)(?P<text>.*?)(<!-- / -->)", re.DOTALL)
PAGES = ("README.md", "bench/README.md", "docs/**/*.md")
Row = dict[str, Any]


class Results:
    """Files that ``python -m bench --results FOLDER`` has written, one for each part."""

    def __init__(self, folder: Path = FOLDER) -> None:
        files = [json.loads(path.read_text()) for path in sorted(folder.glob("*.json"))]
        self.parts: dict[str, Any] = {file["part"]: file for file in files}
        #: The quartiles of each metric and target, by path.
        self.quartiles: dict[str, list[float]] = {}
        for part in self.parts:
            for row in self.rows(part):
                labels = [row[each] for each in self.parts[part]["labels"] if each != "trials"]
                path = "/".join(str(each) for each in (part, *labels) if each is not None)
                found = {f"{path}/{key}": row[key] for key in row if isinstance(row[key], list)}
                self.quartiles |= found
        for target in self.targets():
            self.quartiles[f"{target['part']}/{target['name']}"] = target["found"]

    def rows(self, part: str, **labels: object) -> list[Row]:
        """The rows of a part that have these labels."""
        file = self.parts[part]
        count, rows = len(file["labels"]), []
        for values in file["rows"]:
            row = dict(zip(file["labels"], values[:count], strict=True))
            for metric, found in zip(file["metrics"], values[count:], strict=True):
                if found is not None:
                    row[metric] = _quartiles(found)
            if labels.items() <= row.items():
                rows.append(row)
        return rows

    def targets(self) -> list[Row]:
        return [
            {"part": part} | target | {"found": _quartiles(target["found"])}
            for part, file in self.parts.items()
            for target in file["targets"]
        ]

    def require_current(self) -> None:
        """Ends the program if the code has changed since it was measured."""
        commits = {part: file["commit"] for part, file in self.parts.items()}
        if len({*commits.values()}) != 1:
            raise SystemExit(f"the results are of different commits: {commits}")
        commit = str(next(iter(commits.values())))
        if changed := changed_since(commit):
            files = ", ".join(changed[:5]) + (", ..." if len(changed) > 5 else "")
            raise SystemExit(
                f"the results are of commit {commit[:12]}, and {len(changed)} files that can "
                f"change them differ from it ({files}): run `make bench RESULTS=bench/results`"
            )

    def number(self, key: str) -> str:
        """The text of a key; an unknown one raises KeyError."""
        path, *forms = key.split(";")
        if path not in self.quartiles:
            return self._about()[key]
        values = [value / 1e6 if "M" in forms else value for value in self.quartiles[path]]
        low, median, high = map(digits, values)
        return f"{median} ({low} to {high})" if "range" in forms else median

    def _about(self) -> dict[str, str]:
        files, targets = list(self.parts.values()), self.targets()
        missed = [target for target in targets if not target["reached"]]
        lines = ["\n", "| part | target | wanted | measured |", "|---|---|---|---|"]
        for target in missed:
            wanted = target["wanted"].replace("<", "&lt;")
            # As kept, with three digits: two would print 0.996 as the 1 that it has missed.
            low, median, high = (digits(value, least=3) for value in target["found"])
            found = f"{median} ({low} to {high})"
            lines.append(f"| `{target['part']}` | {target['name']} | {wanted} | {found} |")
        first = files[0]
        # A part that was measured alone is of another commit, and may be of another machine.
        alone = "".join(
            f"; `{file['part']}` on {_machine(file)} at commit {file['commit']:.12}, {file['date']}"
            for file in files
            if file["commit"] != first["commit"]
        )
        load, others = (max(file[key] for file in files) for key in ("load", "background_cores"))
        return {
            "machine": _machine(first),
            "conditions": f"commit {first['commit']:.12}, {first['date']}{alone}; the load was "
            f"{load:g} at the start, and other programs used at most {others:g} cores in a part",
            "minutes": f"{sum(file['seconds'] for file in files) / 60:.0f}",
            "targets": str(len(targets)),
            "missed": str(len(missed)),
            "missed-table": "\n".join([*lines, "\n"]),
        }

    def filled(self, text: str) -> str:
        """The text of a page with each number as measured."""
        return MARKER.sub(lambda match: match[1] + self.number(match["key"]) + match[4], text)


def rewrite_pages(results: Results) -> None:
    for path in (path for pattern in PAGES for path in sorted(ROOT.glob(pattern))):
        try:
            path.write_text(results.filled(path.read_text()))
        except KeyError as key:
            raise SystemExit(f"{path.relative_to(ROOT)}: no result has the key {key}") from None


def digits(value: float, least: int = 2) -> str:
    """At least so many significant digits, three from 10 on; no exponent."""
    count = max(least, 3 if value >= 10 else 2)
    return f"{float(f'{value:.{count}g}'):,.10g}"


def _machine(file: Row) -> str:
    return "{cores} cores of an {cpu}".format(**file["machine"])


def _quartiles(found: float | list[float]) -> list[float]:
    """As `Report.write` keeps them: one number if all are equal."""
    return found if isinstance(found, list) else 3 * [found]
