"""``python -m tests.attack.table BEFORE.json AFTER.json``: findings of two runs as Markdown."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

from .__main__ import cases

Findings = dict[str, dict[str, Any]]


def _findings(path: str, number: str) -> Findings:
    records = json.loads(Path(path).read_text()).get(number, [])
    return {record["name"]: record for record in records}


def _value(record: dict[str, Any] | None) -> str:
    if record is None or math.isnan(record["value"]):
        return "-"
    return f"{record['value']:,.4g} {record['unit']}".strip()


def _bound(record: dict[str, Any]) -> str:
    return "" if math.isinf(record["bound"]) else f"{record['bound']:g} {record['unit']}".strip()


def lines(before: str, after: str) -> list[str]:
    """The table; what misses its bound is bold."""
    found = ["| case | measured | before | after | bound |", "|---|---|---|---|---|"]
    for number, case in cases().items():
        old, new = _findings(before, number), _findings(after, number)
        what = (case.__doc__ or "").replace("\n", " ")
        for name in dict.fromkeys([*old, *new]):
            record = new.get(name) or old[name]
            now = _value(new.get(name))
            if name in new and not record["kept"]:
                now = f"**{now}**"
            row = (what, name, _value(old.get(name)), now, _bound(record))
            found.append("| " + " | ".join(row) + " |")
            what = ""
    return found


if __name__ == "__main__":
    print("\n".join(lines(*sys.argv[1:])))
