"""The kept results, for the documentation's numbers and figures."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from bench.machine import ROOT, changed_since

FOLDER = ROOT / "bench/results"
Row = dict[str, Any]


class Results:
    """Files that ``python -m bench --results FOLDER`` has written, one for each part."""

    def __init__(self, folder: Path = FOLDER) -> None:
        files = [json.loads(path.read_text()) for path in sorted(folder.glob("*.json"))]
        self.parts: dict[str, Any] = {file["part"]: file for file in files}

    def rows(self, part: str, **labels: object) -> list[Row]:
        """The rows of a part that have these labels."""
        file = self.parts[part]
        count = len(file["labels"])
        rows = []
        for values in file["rows"]:
            row = dict(zip(file["labels"], values[:count], strict=True))
            for metric, found in zip(file["metrics"], values[count:], strict=True):
                if found is not None:
                    row[metric] = _quartiles(found)
            rows.append(row)
        return [row for row in rows if all(row.get(name) == labels[name] for name in labels)]

    def quartiles(self, part: str, metric: str, **labels: object) -> list[float]:
        """Of the only row with these labels."""
        rows = self.rows(part, **labels)
        if len(rows) != 1:
            raise SystemExit(f"{len(rows)} rows of {part} have {labels}, not one")
        found: list[float] = rows[0][metric]
        return found

    def median(self, part: str, metric: str, **labels: object) -> float:
        return self.quartiles(part, metric, **labels)[1]

    def targets(self, part: str = "", start: str = "") -> list[Row]:
        """The targets of a part, or of all, whose names start so."""
        found = (target for name in ([part] if part else self.parts) for target in self._of(name))
        return [target for target in found if target["name"].startswith(start)]

    def _of(self, part: str) -> list[Row]:
        return [
            {"part": part} | target | {"found": _quartiles(target["found"])}
            for target in self.parts[part]["targets"]
        ]

    def commit(self) -> str:
        """The one commit of all parts."""
        commits = {part: file["commit"] for part, file in self.parts.items()}
        if len({*commits.values()}) != 1:
            raise SystemExit(f"the results are of different commits: {commits}")
        return str(next(iter(commits.values())))

    def require_current(self) -> None:
        """Ends the program if the code has changed since it was measured."""
        commit = self.commit()
        if changed := changed_since(commit):
            files = ", ".join(changed[:5]) + (", ..." if len(changed) > 5 else "")
            raise SystemExit(
                f"the results are of commit {commit[:12]}, and {len(changed)} files that can "
                f"change them differ from it ({files}): run `make bench RESULTS=bench/results`"
            )


def _quartiles(found: float | list[float]) -> list[float]:
    """As `Report.write` keeps them: one number if all are equal."""
    return found if isinstance(found, list) else 3 * [found]
