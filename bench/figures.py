"""``make figures``: the documentation's numbers and figures from the kept results; measures
nothing. Refuses results of another commit than the code that they measure."""

from __future__ import annotations

import argparse

from bench import numbers, plots
from bench.machine import ROOT
from bench.results import Results


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.figures", description=__doc__)
    parser.add_argument("--anyway", action="store_true", help="draw results of another commit")
    results = Results()
    if not parser.parse_args().anyway:
        results.require_current()
    numbers.rewrite(results)
    plots.draw(results, ROOT / "docs/figures")


if __name__ == "__main__":
    main()
