"""Prints medians of trials with their quartiles. Systems that are compared take turns in one run,
because figures of different runs say little about each other."""

from __future__ import annotations

import argparse
import importlib
from pathlib import Path

from bench import machine
from bench.report import Report

#: The parts that need no Python package, and the others; the module of each, and its function.
CORE = {
    "native": "native:lookups",
    **{part: f"native:{part}" for part in ("paper", "delay", "staleness", "memory")},
}
PARTS = CORE | {
    "embedded": "embedded:measure",
    "sensors": "sensors:measure",
    "reads": "reads:measure",
    "readers": "readers:measure",
    "remote": "remote:measure",
    "waiting": "remote:waiting",
    "mirrors": "mirrors:measure",
    "async": "asynchronous:measure",
}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench", description=__doc__)
    names = f"of {', '.join(PARTS)}; core: {', '.join(CORE)}; none: all"
    choices = [*PARTS, "core", []]
    parser.add_argument("parts", nargs="*", metavar="PART", choices=choices, help=names)
    parser.add_argument("--quick", action="store_true", help="one tiny trial each: does it work?")
    parser.add_argument("--results", type=Path, metavar="FILE", help="write the medians as JSON")
    args = parser.parse_args()
    chosen = [part for name in args.parts for part in (CORE if name == "core" else (name,))]
    report = Report(machine.describe(), args.quick)
    for key, value in report.machine.items():
        print(f"{key}: {value}")
    for part in chosen or PARTS:
        print(f"\n== {part}", flush=True)
        module, function = PARTS[part].split(":")
        getattr(importlib.import_module(f"bench.{module}"), function)(report)
    if args.results is not None:
        report.write(args.results)


if __name__ == "__main__":
    main()
