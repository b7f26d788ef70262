"""Prints medians of trials with their quartiles. Systems that are compared take turns in one run,
because figures of different runs say little about each other."""

from __future__ import annotations

import argparse
import importlib
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from bench import machine
from bench.report import Report

#: The parts that need no Python package, and the others; the module of each, and its function.
CORE = {
    part: f"native:{part.replace('-', '_')}"
    for part in ("lookups", "paper", "paper-cached", "delay", "staleness", "memory")
}
PARTS = CORE | {
    "embedded": "embedded:measure",
    "sensors": "sensors:measure",
    "reads": "reads:measure",
    "readers": "readers:measure",
    "rows": "queries:rows",
    "waiting": "queries:waiting",
    "mirrors": "mirrors:measure",
    "async": "asynchronous:measure",
    "sizing": "sizing:measure",
}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench", description=__doc__)
    names = f"of {', '.join(PARTS)}; core: {', '.join(CORE)}; none: all"
    parser.add_argument(
        "parts", nargs="*", metavar="PART", choices=[*PARTS, "core", []], help=names
    )
    parser.add_argument("--quick", action="store_true", help="one tiny trial each: does it work?")
    parser.add_argument("--results", type=Path, metavar="FOLDER", help="write a file for each part")
    note = f"write results in spite of a load above {machine.MAX_LOAD:g} or uncommitted changes"
    parser.add_argument("--anyway", action="store_true", help=note)
    args = parser.parse_args()
    if args.quick and args.results:
        parser.error("--quick measures nothing that is worth writing: leave out --results")
    chosen = [part for name in args.parts for part in (CORE if name == "core" else (name,))]
    header: dict[str, Any] = _conditions(bool(args.results and not args.anyway))
    begun_s = time.monotonic()
    for number, part in enumerate(chosen or PARTS, 1):
        spent_s = time.monotonic() - begun_s
        print(
            f"\n== {part} ({number} of {len(chosen or PARTS)}, after {spent_s:.0f} s)", flush=True
        )
        report, background, part_s = Report(args.quick), machine.Background(), time.monotonic()
        name, function = PARTS[part].split(":")
        getattr(importlib.import_module(f"bench.{name}"), function)(report)
        spent: dict[str, Any] = {"seconds": round(time.monotonic() - part_s)}
        spent["background_cores"] = round(background.cores(), 2)
        print(f"\n{part}: {spent}", flush=True)
        if args.results:
            report.write(args.results / f"{part}.json", {"part": part} | header | spent)
    print(f"\nall: {time.monotonic() - begun_s:.0f} s")


def _conditions(strict: bool) -> dict[str, Any]:
    """Prints under which conditions this run measures; `strict` refuses those that spoil it."""
    load, commit, about = machine.load(), machine.commit(), machine.describe()
    date = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    facts = {"commit": commit, "date": date, "load": round(load, 2)}
    for key, value in (facts | about).items():
        print(f"{key}: {value}")
    if strict and load > machine.MAX_LOAD:
        raise SystemExit(
            f"the load is {load:.2f}, more than {machine.MAX_LOAD:g}, so no results are written: "
            "end other programs and wait a minute, or use --anyway"
        )
    if strict and commit.endswith("-dirty"):
        raise SystemExit("uncommitted changes of measured files: commit them, or use --anyway")
    return facts | {"machine": about}


if __name__ == "__main__":
    main()
