"""Torn reads: a chain whose x translations sum to zero in every transaction.

The sum is exact in float64, so any other sum mixes two transactions. Writers and readers run as
processes on a server; `tests/core/lookups/test_concurrent_reads.cpp` has the same of threads.
"""

from __future__ import annotations

import json
import random
import sys
import time
from collections import Counter
from typing import Any, Protocol

from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import TransformClient

LINKS = 8
ROOT, MIDDLE, LEAF = "link0", f"link{LINKS // 2}", f"link{LINKS}"
PLAIN = "lookup_latest_transform"
#: Not a lookup, but two, one after the other: between them a transaction may commit.
HALVES = "halves"


class Sets(Protocol):
    def set_transforms_xact(self, stampeds: list[StampedTransform]) -> object: ...


def zero_sum(random: random.Random, stamp_ns: int) -> list[StampedTransform]:
    """Return the links of one transaction, in random order."""
    xs = [float(random.randrange(-1000, 1000)) for _ in range(LINKS - 1)]
    xs.append(-sum(xs))
    links = [
        StampedTransform(f"link{i}", f"link{i + 1}", stamp_ns, Transform((x, 0.0, 0.0)))
        for i, x in enumerate(xs)
    ]
    random.shuffle(links)
    return links


def write(tf: Sets, seed: int, until: float) -> int:
    """Commit until a monotonic time; return the number of commits."""
    rng = random.Random(seed)
    commits = 0
    while time.monotonic() < until:
        tf.set_transforms_xact(zero_sum(rng, time.time_ns()))
        commits += 1
    return commits


def read(tf: Any, lookups: list[str], until: float) -> Counter[tuple[str, bool]]:
    """Look up until a monotonic time; return how many results were torn and how many were not."""
    seen: Counter[tuple[str, bool]] = Counter()

    def x_of(name: str, target: str, source: str) -> float:
        found: StampedTransform = getattr(tf, name)(target, source)
        return found.transform.pose()[0]

    while time.monotonic() < until:
        for name in lookups:
            if name == HALVES:
                sum_x = x_of(PLAIN, ROOT, MIDDLE) + x_of(PLAIN, MIDDLE, LEAF)
            else:
                sum_x = x_of(name, ROOT, LEAF)
            seen[name, sum_x != 0.0] += 1
    return seen


def main(role: str, endpoint: str, seconds: float, seed_or_lookups: str) -> None:
    """Run as a process: write or read on a server, then print the counts."""
    with TransformClient.connect(endpoint) as tf:
        until = time.monotonic() + seconds
        if role == "write":
            print(json.dumps(write(tf, int(seed_or_lookups), until)))
        else:
            seen = read(tf, seed_or_lookups.split(","), until)
            print(json.dumps([[name, torn, n] for (name, torn), n in seen.items()]))


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], float(sys.argv[3]), sys.argv[4])
