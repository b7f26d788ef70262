"""A mirror: ``python -m bench.mirror_process ENDPOINT KIND``. Samples its age, and the age of a
pose that it reads. Each line on stdin is answered with their medians and tails since the last."""

from __future__ import annotations

import json
import sys
import threading
import time

import numpy as np

from zenoh_tf_client import Mirror, TransformClient

#: The frames of the interest are three: the parent of the pair's frames, and these.
TARGET, SOURCE = "robot3/frame10", "robot3/frame11"
_PERIOD_S = 0.1


def mirror(tf: TransformClient, kind: str) -> Mirror:
    if kind.startswith("interest"):
        return tf.mirror([(TARGET, SOURCE)], max_delay_s=0 if kind == "interest at once" else None)
    return tf.mirror(max_rate_hz=10) if kind == "thinned" else tf.mirror()


def main() -> None:
    with TransformClient.connect(sys.argv[1], reads="query") as tf, mirror(tf, sys.argv[2]) as m:
        ages: list[float] = []
        poses: list[float] = []

        def sample() -> None:
            while True:
                ages.append(m.age_s)
                stamp_ns = m.lookup_latest_transform(TARGET, SOURCE).stamp_ns
                poses.append((time.monotonic_ns() - stamp_ns) / 1e9)
                time.sleep(_PERIOD_S)

        m.lookup_latest_transform(TARGET, SOURCE)
        print("ready", flush=True)
        threading.Thread(target=sample, daemon=True).start()
        while sys.stdin.readline():
            found: dict[str, float] = {"frames": len(m.frames())}
            for name, values in (("age", ages), ("pose_age", poses)):
                median, tail = 1e3 * np.percentile(values, (50, 99))
                found |= {f"{name}_ms": float(median), f"{name}_p99_ms": float(tail)}
                values.clear()
            print(json.dumps(found), flush=True)


if __name__ == "__main__":
    main()
