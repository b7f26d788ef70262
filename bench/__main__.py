"""``python -m bench [PART]... [--quick] [--results FILE]``

Prints medians of trials with their quartiles. Systems that are compared take turns in one run,
because figures of different runs say little about each other.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from pathlib import Path

from bench import machine
from bench.report import Report

#: Part, and the function that measures it. A part's module is imported when it is needed: those of
#: CORE need no package.
PARTS = {
    "native": "bench.native:lookups",
    "paper": "bench.native:paper",
    "delay": "bench.native:delay",
    "shapes": "bench.native:shapes",
    "staleness": "bench.native:staleness",
    "memory": "bench.native:memory",
    "embedded": "bench.embedded:measure",
    "remote": "bench.remote:measure",
    "waiting": "bench.waiting:measure",
}
CORE = ("native", "paper", "delay", "shapes", "staleness", "memory")


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m bench",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    names = f"of {', '.join(PARTS)}; core: {', '.join(CORE)}; none: all"
    parser.add_argument("parts", nargs="*", metavar="PART", help=names)
    parser.add_argument("--quick", action="store_true", help="one tiny trial each: does it work?")
    parser.add_argument("--results", type=Path, metavar="FILE", help="write the medians as JSON")
    args = parser.parse_args()
    chosen = [part for name in args.parts for part in (CORE if name == "core" else (name,))]
    if unknown := set(chosen) - set(PARTS):
        parser.error(f"no such part: {', '.join(sorted(unknown))}")
    report = Report(machine.describe(), args.quick)
    for key, value in report.machine.items():
        print(f"{key}: {value}")
    for part in chosen or PARTS:
        print(f"\n== {part}", flush=True)
        module, function = PARTS[part].split(":")
        getattr(importlib.import_module(module), function)(report)
    report.machine["load_at_end"] = machine.load()
    print(f"\nload at the end: {report.machine['load_at_end']}")
    if args.results is not None:
        report.write(args.results)
    return 0


if __name__ == "__main__":
    sys.exit(main())
