"""``python -m bench [embedded] [remote]``: measure, print one JSON document.

Figures are medians over repeats, on whatever else the machine is doing meanwhile; compare only what
was measured in one run.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

from bench import embedded, remote

PARTS: dict[str, Callable[[float], dict[str, float]]] = {
    "embedded": embedded.measure,
    "remote": remote.measure,
}


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m bench", description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}")
    parser.add_argument("--seconds", type=float, default=1.0, help="per figure (default 1)")
    args = parser.parse_args()
    unknown = set(args.parts) - set(PARTS)
    if unknown:
        parser.error(f"no such part: {', '.join(sorted(unknown))}")
    document: dict[str, object] = {"machine": _machine()}
    for part in args.parts or PARTS:
        print(f"measuring: {part}", file=sys.stderr, flush=True)
        document[part] = PARTS[part](args.seconds)
    print(json.dumps(document, indent=2))
    return 0


def _machine() -> dict[str, object]:
    cpu = platform.processor()
    information = Path("/proc/cpuinfo")
    if information.exists():
        models = [s for s in information.read_text().splitlines() if s.startswith("model name")]
        cpu = models[0].split(":", 1)[1].strip() if models else cpu
    return {
        "cpu": cpu,
        "cores": os.cpu_count(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "zenoh_tf": version("zenoh-tf"),
        "eclipse_zenoh": version("eclipse-zenoh"),
    }


if __name__ == "__main__":
    sys.exit(main())
