"""A health check for containers: ``python -m zenoh_tf_tools.health``.

The exit code is 0 if the tree's server answered a lookup, or was too busy for it, else 1 with one
line on stderr that says why. So it also finds a server whose process lives but no longer answers.
``ZENOH_TF_CONNECT``, ``ZENOH_TF_TREE`` and the variables of the credentials are the defaults of its
options.
"""

from __future__ import annotations

import argparse
import sys

from zenoh_tf.errors import ServerBusy, TransformException
from zenoh_tf.text import printable
from zenoh_tf.text.time_flags import duration
from zenoh_tf_client.session import environment
from zenoh_tf_tools.cli.connection import add_credentials, connect

# Any name will do; the tree need not have such a frame.
_FRAME = "zenoh-tf-health"


def main() -> int:
    """Check once; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m zenoh_tf_tools.health",
        description="Exit with 0 if the server answers, else with 1.",
    )
    parser.add_argument("--connect", action="append", metavar="ENDPOINT")
    parser.add_argument("--tree", default=environment.tree())
    parser.add_argument("--timeout", type=duration(above=True), default=2.0, metavar="DURATION")
    add_credentials(parser)
    args = parser.parse_args()
    try:
        # The memory of a server that serves nobody any more would still answer.
        with connect(args, reads="query") as tf:
            tf.can_transform(_FRAME, _FRAME)
    except ServerBusy:
        return 0  # it answers: a restart would not make it less busy
    except TransformException as error:
        print(printable(f"unhealthy: {type(error).__name__}: {error}"), file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
