"""Random histories of a tree: writes, and questions after each of them.

There are few frames, stamps on a coarse grid around a moving clock, and a cache of ten grid steps.
So stamps repeat, come late or too late, frames change parent or become static, and cycles close.

The environment variable ``HISTORIES`` sets their number (default: about a hundred; ``make
histories``: 10,000), and ``HISTORY_SEED`` selects a single one.
"""

from __future__ import annotations

import math
import os
import random
from typing import Literal, NamedTuple, TypeVar

from .calls import Call
from .oracle import Row
from .poses import Pose

T = TypeVar("T")

FRAMES = ("map", "base", "arm", "tool", "camera", "object")
GRID_NS = 100_000_000
CACHE_NS = 10 * GRID_NS
SHALLOW, DEEP = 3, 20  # max_depth: a limit that paths reach, and one that only loops reach

SEEDS = range(int(os.environ.get("HISTORIES", "150")))
if "HISTORY_SEED" in os.environ:
    SEEDS = range(int(os.environ["HISTORY_SEED"]), int(os.environ["HISTORY_SEED"]) + 1)

Step = tuple[Call, list[Call]]  # a write, and the questions after it


class History(NamedTuple):
    seed: int
    max_depth: int
    time_jump: Literal["reject", "clear"]
    steps: list[Step]

    def __str__(self) -> str:
        lines = [f"seed {self.seed}, max_depth {self.max_depth}, time_jump {self.time_jump}"]
        for number, (write, _) in enumerate(self.steps):
            lines.append(f"{number:4} {write}")
        return "\n".join(lines)


def history(seed: int, writes: int = 40, start_ns: int = -10 * GRID_NS) -> History:
    """Return the history of a seed; ``start_ns`` is added to all of its stamps."""
    return _Making(seed, start_ns).history(writes)


class _Making:
    def __init__(self, seed: int, start_ns: int) -> None:
        self.seed = seed
        self.random = random.Random(seed)
        self.clock_ns = start_ns
        self.used = list(FRAMES[: self.random.randint(3, len(FRAMES))])

    def history(self, writes: int) -> History:
        max_depth = SHALLOW if self.random.random() < 0.2 else DEEP
        time_jump: Literal["reject", "clear"] = "clear" if self.random.random() < 0.2 else "reject"
        back = -40 if time_jump == "clear" else 40
        steps = []
        for _ in range(writes):
            self.clock_ns += self._one_of({0: 5, 1: 8, 2: 2, back: 0.3}) * GRID_NS
            steps.append((self._write(), [self._question() for _ in range(4)]))
        return History(self.seed, max_depth, time_jump, steps)

    def _one_of(self, weights: dict[T, float]) -> T:
        return self.random.choices(list(weights), list(weights.values()))[0]

    def _write(self) -> Call:
        authority = self.random.choice(("", "odometry", "camera"))
        match self._one_of({"set": 30, "xact": 8, "clear": 0.7, "remove": 1, "reset": 0.1}):
            case "set":
                return Call("set_transform", (self._row(), authority, self.random.random() < 0.12))
            case "xact":
                rows = tuple(self._row() for _ in range(self.random.randint(0, 4)))
                return Call("set_transforms_xact", (rows, authority, self.random.random() < 0.1))
            case "remove":
                return Call("remove_frame", (self._frame(), self.random.random() < 0.5))
            case "reset":
                return Call("reset", ())
        return Call("clear", (self.random.random() < 0.7,))

    def _row(self) -> Row:
        parent, child = self.random.sample(range(len(self.used)), 2)
        if parent > child and self.random.random() < 0.8:
            parent, child = child, parent
        if child - parent > 1 and self.random.random() < 0.5:
            parent = child - 1
        row = Row(self.used[parent], self.used[child], self._stamp_to_set(), self._pose())
        return self._spoilt(row) if self.random.random() < 0.03 else row

    def _spoilt(self, row: Row) -> Row:
        def scaled(by: float) -> Pose:
            x, y, z, qx, qy, qz, qw = row.pose
            return (x, y, z, by * qx, by * qy, by * qz, by * qw)

        return self.random.choice(
            [
                row._replace(parent=row.child),
                row._replace(child=""),
                row._replace(parent="/"),
                row._replace(parent="/" + row.parent, child="/" + row.child),  # is good
                row._replace(child="//" + row.child),
                row._replace(pose=(1e151, *row.pose[1:])),
                row._replace(pose=(math.nan, *row.pose[1:])),
                row._replace(pose=(*row.pose[:1], math.inf, *row.pose[2:])),
                row._replace(pose=(*row.pose[:3], math.nan, *row.pose[4:])),
                row._replace(pose=scaled(0.0)),
                row._replace(pose=scaled(1.006)),
                row._replace(pose=scaled(1.004)),  # is good
            ]
        )

    def _stamp_to_set(self) -> int:
        steps = self._one_of(
            {0: 6, 1: 4, 2: 2} | dict.fromkeys(range(-9, 0), 0.6) | {-10: 1, -11: 0.7, -14: 0.3}
        )
        off_grid = self._one_of({0: 12, 1: 1, -1: 1})
        return self.clock_ns + steps * GRID_NS + off_grid

    def _pose(self) -> Pose:
        def quaternion(spread: float) -> tuple[float, float, float, float]:
            x, y, z = (self.random.gauss(0, spread) for _ in range(3))
            w = self.random.gauss(0, 1)
            norm = math.sqrt(x * x + y * y + z * z + w * w)
            return (x / norm, y / norm, z / norm, w / norm)

        x, y, z = (self.random.uniform(-5, 5) for _ in range(3))
        # Any rotation, a small one as between consecutive samples, or none.
        return (x, y, z, *quaternion(self._one_of({1.0: 5, 0.01: 3, 1e-6: 1, 0.0: 1})))

    def _question(self) -> Call:
        a, b = self._frame(), self._frame()
        match self._one_of(
            {"at": 14, "latest": 4, "several": 1, "full": 4, "time": 2, "sample": 2}
            | {"can": 2, "chain": 2, "parent": 2, "frame": 2, "frames": 0.5, "stats": 0.5}
        ):
            case "at":
                return Call("lookup_transform", (a, b, self._stamp_to_ask()))
            case "latest":
                xact = "_xact" if self.random.random() < 0.5 else ""
                return Call(f"lookup_latest_transform{xact}", (a, b))
            case "several":
                return Call("lookup_latest_transforms_xact", ([(a, b), (b, self._frame())],))
            case "full":
                times = self._stamp_to_ask(), self._stamp_to_ask()
                return Call("lookup_transform_full", (a, times[0], b, times[1], self._frame()))
            case "time":
                return Call("latest_common_time", (a, b))
            case "sample":
                times_ns = [self._time_to_ask() for _ in range(self.random.randint(0, 12))]
                if self.random.random() < 0.7:
                    times_ns.sort()
                return Call("sample", (a, b, times_ns))
            case "can":
                return Call("can_transform", (a, b, self._stamp_to_ask()))
            case "chain":
                return Call("chain", (a, b, self._stamp_to_ask()))
            case "parent":
                return Call("parent", (a, self._stamp_to_ask()))
            case "frame":
                return Call("frame", (a,))
            case "stats":
                return Call("stats", ())
        return Call("frames", ())

    def _frame(self) -> str:
        odd = self._one_of({"": 60, "nowhere": 1, "slash": 0.5, "empty": 0.5})
        if odd == "nowhere":
            return odd
        if odd == "empty":
            return ""
        return ("/" if odd else "") + self.random.choice(self.used)

    def _stamp_to_ask(self) -> int | None:
        return None if self.random.random() < 0.25 else self._time_to_ask()

    def _time_to_ask(self) -> int:
        steps = self._one_of(dict.fromkeys(range(-8, 2), 2.0) | {-16: 0.3, -11: 1, -10: 1, 3: 0.5})
        off_grid = self._one_of({0: 3, 1: 1, -1: 1, self.random.randrange(GRID_NS): 6})
        return self.clock_ns + steps * GRID_NS + off_grid
