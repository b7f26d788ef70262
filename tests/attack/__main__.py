"""``python -m tests.attack``: plays the attacks on real servers and measures what they do.

``--case 3a`` plays one case, or several; ``--case 3`` all variants of 3. ``--python PATH`` runs
servers and SDK clients of another checkout. Exit status 1 if a bound is missed.
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

from . import cases_connections, cases_load
from .arena import CASES, Arena, Case, Finding

#: Imported for their cases.
MODULES = (cases_load, cases_connections)


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


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.attack", description=__doc__)
    parser.add_argument("--case", nargs="*", default=[], help="numbers, such as 3 or 3a")
    parser.add_argument("--python", default=sys.executable, help="interpreter to attack")
    parser.add_argument("--json", type=Path, help="file for the findings")
    options = parser.parse_args()
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
