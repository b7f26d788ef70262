"""Prints medians of trials with their quartiles. Systems that are compared take turns in one run,
because figures of different runs say little about each other."""

from __future__ import annotations

import argparse
import time
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from bench import machine
from bench.parts import asynchronous, cpp, crowd, estimate, mirrors, native, reads, sensors, service
from bench.report import Report

#: The parts that need no Python package, together named "core".
CORE = {
    "lookups": native.lookups,
    "paper": native.paper,
    "paper-cached": native.paper_cached,
    "delay": native.delay,
    "staleness": native.staleness,
    "memory": native.memory,
}
PARTS = CORE | {
    "embedded": reads.embedded,
    "sensors": sensors.measure,
    "reads": reads.reads,
    "readers": reads.readers,
    "cpp": cpp.measure,
    "rows": service.rows,
    "waiting": service.waiting,
    "mirrors": mirrors.measure,
    "async": asynchronous.measure,
    "sizing": service.sizing,
    "crowd": crowd.measure,
    "estimate": estimate.measure,
}
#: A higher load average spoils results.
MAX_LOAD = 1.0


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench", description=__doc__)
    names = f"of {', '.join(PARTS)}; core: {', '.join(CORE)}; none: all"
    choices = [*PARTS, "core", []]
    parser.add_argument("parts", nargs="*", metavar="PART", choices=choices, help=names)
    parser.add_argument("--quick", action="store_true", help="one tiny trial each: does it work?")
    parser.add_argument("--results", type=Path, metavar="FOLDER", help="write a file for each part")
    note = f"write results in spite of a load above {MAX_LOAD:g} or uncommitted changes"
    parser.add_argument("--anyway", action="store_true", help=note)
    args = parser.parse_args()
    if args.quick and args.results:
        parser.error("--quick measures nothing that is worth writing: leave out --results")
    header = _conditions(bool(args.results and not args.anyway))
    chosen = [part for name in args.parts for part in (CORE if name == "core" else (name,))]
    for part in chosen or PARTS:
        print(f"\n== {part}", flush=True)
        report, others_s, begun_s = Report(args.quick), machine.others_s(), time.monotonic()
        PARTS[part](report)
        took_s = time.monotonic() - begun_s
        others = max(0.0, (machine.others_s() - others_s) / took_s)
        spent = {"seconds": round(took_s), "background_cores": round(others, 2)}
        print(f"\n{part}: {spent}", flush=True)
        if args.results:
            report.write(args.results / f"{part}.json", {"part": part} | header | spent)


def _conditions(strict: bool) -> dict[str, Any]:
    """Prints under which conditions this run measures; `strict` refuses those that spoil it."""
    load, commit = machine.load(), machine.commit()
    date = datetime.now(timezone.utc).strftime("%Y-%m-%d %H:%M UTC")
    facts = {"commit": commit, "date": date, "load": round(load, 2), "machine": machine.describe()}
    for key, value in facts.items():
        print(f"{key}: {value}")
    if strict and load > MAX_LOAD:
        raise SystemExit(
            f"the load is {load:.2f}, more than {MAX_LOAD:g}, so no results are written: "
            "end other programs and wait a minute, or use --anyway"
        )
    if strict and commit.endswith("-dirty"):
        raise SystemExit("uncommitted changes of measured files: commit them, or use --anyway")
    return facts


if __name__ == "__main__":
    main()
