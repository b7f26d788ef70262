"""Is a server well? ``python -m zenoh_tf_client.health`` asks it a real question.

For health checks of containers and orchestrators: exit code 0 if the tree's server answered, else 1
and one line on stderr that says why. It asks by the way that every client asks, so it sees a server
whose process lives but which no longer answers. ``ZENOH_TF_CONNECT`` and ``ZENOH_TF_TREE`` give the
defaults.
"""

from __future__ import annotations

import argparse
import sys

from zenoh_tf import TransformException
from zenoh_tf_client import TransformClient, environment

# Any name does: whether the tree has such a frame is not what is asked.
_FRAME = "zenoh-tf-health"


def main() -> int:
    """Ask once; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m zenoh_tf_client.health", description="Exit 0 if the server answers, else 1."
    )
    parser.add_argument("--connect", default=environment.endpoint())
    parser.add_argument("--tree", default=environment.tree())
    parser.add_argument("--timeout", type=float, default=2.0, metavar="SECONDS")
    args = parser.parse_args()
    try:
        with TransformClient.connect(args.connect, tree=args.tree, timeout_s=args.timeout) as tf:
            tf.can_transform(_FRAME, _FRAME)
    except TransformException as error:
        print(f"unhealthy: {type(error).__name__}: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
