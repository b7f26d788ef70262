"""``python -m bench [PART]... [--results FILE]``

Medians of repetitions, with the lowest and the highest. What is compared is measured by turns in
one run and compared pair by pair, for other work on the machine meets both; figures of different
runs say little about each other.
"""

from __future__ import annotations

import argparse
import functools
import json
import shlex
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from bench import core_parts, embedded, machine, native, paper, remote, waiting
from bench.figures import Figure


def _printed(measure: Callable[[], Iterator[Figure]]) -> Callable[[], Any]:
    def run() -> list[dict[str, Any]]:
        figures = []
        for figure in measure():
            print(figure.line(), flush=True)
            figures.append(figure.as_dict())
        return figures

    return run


PARTS: dict[str, Callable[[], Any]] = {
    "native": native.measure,
    "paper": paper.measure,
    "delay": core_parts.delay,
    "shapes": core_parts.shapes,
    "staleness": core_parts.staleness,
    "memory": core_parts.memory,
    "embedded": _printed(embedded.measure),
    "remote": _printed(remote.measure),
    "waiting": _printed(waiting.measure),
}

#: The parts that need neither Python's speed nor a network.
CORE = ("native", "paper", "delay", "shapes", "staleness", "memory")


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m bench",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}; core: {', '.join(CORE)}"
    )
    parser.add_argument("--results", type=Path, metavar="FILE", help="write all of it as JSON")
    parser.add_argument(
        "--paper-flags",
        type=shlex.split,
        metavar="FLAGS",
        help="of the part paper, as in bench/core/parts.hpp: other cells, longer turns",
    )
    args = parser.parse_args()
    chosen = [part for name in args.parts for part in (CORE if name == "core" else (name,))]
    unknown = set(chosen) - set(PARTS)
    if unknown:
        parser.error(f"no such part: {', '.join(sorted(unknown))}")
    parts = PARTS | {"paper": functools.partial(paper.measure, args.paper_flags or ())}
    document: dict[str, Any] = {"machine": machine.describe()}
    for key, value in document["machine"].items():
        print(f"{key}: {value}")
    for part in chosen or PARTS:
        print(f"\n== {part}", flush=True)
        document[part] = parts[part]()
    document["machine"]["load_at_end"] = machine.load()
    print(f"\nload at the end: {document['machine']['load_at_end']}")
    if args.results is not None:
        args.results.parent.mkdir(parents=True, exist_ok=True)
        args.results.write_text(json.dumps(document, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
