"""A mirror: ``python -m bench.mirror_process ENDPOINT KIND``. Looks now and then how old it is, and
how old the poses are that it reads. Each line on stdin is answered with what it has seen since."""

from __future__ import annotations

import json
import statistics
import sys
import threading
import time

from zenoh_tf_client import Mirror, TransformClient

#: The frames of the interest are three: the parent of the pair's frames, and these.
TARGET, SOURCE = "robot3/frame10", "robot3/frame11"
_LOOK_S = 0.25


def mirror(tf: TransformClient, kind: str) -> Mirror:
    if kind.startswith("interest"):
        return tf.mirror([(TARGET, SOURCE)], max_delay_s=0 if kind == "interest at once" else None)
    return tf.mirror(max_rate_hz=10) if kind == "thinned" else tf.mirror()


def main() -> None:
    with TransformClient.connect(sys.argv[1], reads="query") as tf, mirror(tf, sys.argv[2]) as m:
        ages: list[float] = []
        poses: list[float] = []

        def look() -> None:
            while True:
                time.sleep(_LOOK_S)
                ages.append(m.age_s)
                stamp_ns = m.lookup_latest_transform(TARGET, SOURCE).stamp_ns
                poses.append((time.monotonic_ns() - stamp_ns) / 1e9)

        print("ready", flush=True)
        threading.Thread(target=look, daemon=True).start()
        while sys.stdin.readline():
            found: dict[str, float] = {"snapshots": m._feed.snapshots, "frames": len(m.frames())}
            for name, values in (("age", ages), ("pose_age", poses)):
                cuts = statistics.quantiles([*values, 0.0, 0.0], n=100)
                found |= {f"{name}_ms": 1e3 * cuts[49], f"{name}_p99_ms": 1e3 * cuts[98]}
                values.clear()
            print(json.dumps(found), flush=True)


if __name__ == "__main__":
    main()
