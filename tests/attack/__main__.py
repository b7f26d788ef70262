"""``python -m tests.attack``: plays the attacks on real servers and measures what they do.

``--case 3a`` plays one case, or several; ``--case 3`` all variants of 3. ``--python PATH`` runs
servers and SDK clients of another checkout. ``--compare BEFORE.json AFTER.json`` plays nothing and
prints the findings of two runs as Markdown. Exit status 1 if a bound is missed.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import sys
import time
import traceback
from pathlib import Path
from typing import Any

from . import (
    cases_connections,
    cases_cost,
    cases_data,
    cases_exit,
    cases_load,
    cases_memory,
    cases_replica,
)
from .arena import CASES, Arena, Case, Finding

#: Imported for their cases.
MODULES = (
    *(cases_load, cases_cost, cases_data, cases_exit),
    *(cases_memory, cases_replica, cases_connections),
)


def cases() -> dict[str, Case]:
    """All cases in the order of their numbers."""
    return dict(sorted(CASES.items(), key=lambda item: (int(item[0].rstrip("abcdefgh")), item[0])))


def play(number: str, case: Case, arena: Arena) -> list[Finding]:
    print(case.description, flush=True)
    start_s = time.monotonic()
    try:
        findings = case.play(arena)
    except Exception as error:
        traceback.print_exc()
        findings = [Finding("played", math.nan, "", 0, f"{type(error).__name__}: {error}"[:100])]
    for one in findings:
        bound = "" if math.isinf(one.bound) else f"<= {one.bound:g}"
        mark = "" if math.isinf(one.bound) else "ok" if one.kept else "MISSED"
        value = f"{one.value:,.1f} {one.unit}"
        print(f"  {one.name:36} {value:>14} {bound:>9} {mark:6} {one.note}", flush=True)
    print(f"  ({number} took {time.monotonic() - start_s:.0f} s)", flush=True)
    return findings


def compare(before: Path, after: Path) -> list[str]:
    """The table; a value that misses its bound is bold."""
    found = ["| case | measured | before | after | bound |", "|---|---|---|---|---|"]
    runs = [json.loads(path.read_text()) for path in (before, after)]
    for number, case in cases().items():
        old, new = ({record["name"]: record for record in run.get(number, [])} for run in runs)
        description = case.description
        for name in dict.fromkeys([*old, *new]):
            record, now = new.get(name) or old[name], _value(new.get(name))
            now = f"**{now}**" if name in new and not record["kept"] else now
            bound = "" if math.isinf(record["bound"]) else f"{record['bound']:g} {record['unit']}"
            row = (description, name, _value(old.get(name)), now, bound.strip())
            found.append("| " + " | ".join(row) + " |")
            description = ""
    return found


def _value(record: dict[str, Any] | None) -> str:
    if record is None or math.isnan(record["value"]):
        return "-"
    return f"{record['value']:,.4g} {record['unit']}".strip()


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.attack", description=__doc__)
    parser.add_argument("--case", nargs="*", default=[], help="numbers, such as 3 or 3a")
    parser.add_argument("--python", default=sys.executable, help="interpreter to attack")
    parser.add_argument("--json", type=Path, help="file for the findings")
    parser.add_argument("--compare", nargs=2, type=Path, metavar=("BEFORE", "AFTER"))
    options = parser.parse_args()
    if options.compare:
        print("\n".join(compare(*options.compare)))
        return 0
    arena = Arena(options.python)
    known = cases()
    chosen = {
        number: case
        for number, case in known.items()
        if not options.case or number in options.case or number.rstrip("abcdefgh") in options.case
    }
    if not chosen:
        parser.error(f"no such case; there are {', '.join(known)}")
    results = {}
    for number, case in chosen.items():
        results[number] = play(number, case, arena)
        if options.json:
            records = {
                key: [dataclasses.asdict(one) | {"kept": one.kept} for one in found]
                for key, found in results.items()
            }
            options.json.write_text(json.dumps(records, indent=1, default=float) + "\n")
    missed = [number for number, found in results.items() if not all(one.kept for one in found)]
    print(f"missed: {', '.join(missed) or 'none'}")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
