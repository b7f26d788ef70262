"""``zenoh-tf echo`` and ``wait``: a lookup again and again, or until it succeeds."""

from __future__ import annotations

import argparse
import contextlib
import itertools
import time
from collections.abc import Callable, Generator
from typing import Any, Final

from zenoh_tf import ServerUnavailable, StampedTransform, TransformException
from zenoh_tf.text.flag_values import number, whole
from zenoh_tf_client import TransformClient
from zenoh_tf_tools.cli import output
from zenoh_tf_tools.cli.arguments import (
    Commands,
    add_duration,
    add_frames,
    add_live_at,
    add_max_gap,
)
from zenoh_tf_tools.cli.connection import connect
from zenoh_tf_tools.cli.tree import estimate

#: Pause before the next attempt to find a server.
_RETRY_S: Final = 0.2
#: A server without commits sends ten heartbeats a second.
_SILENT_S: Final = 3.0


def add(commands: Commands) -> None:
    echo = commands.add(
        "echo",
        _echo,
        "print the pose of SOURCE in TARGET again and again",
        "Print the pose of SOURCE in TARGET at the latest common time, again and again, until "
        "Ctrl-C. A lookup that fails is reported once on stderr, and tried again. With "
        "--on-change, the server pushes the pose from the newest sample of each link, and it is "
        "printed when it changes. With --estimate, it is the pose now, and how wrong it may be. "
        "--json prints one document per line.",
        "zenoh-tf echo map base_link",
        "zenoh-tf echo map base_link --rate 10 --count 5 --json",
        "zenoh-tf echo map base_link --on-change --count 1",
        "zenoh-tf echo map base_link --estimate --rate 5",
    )
    add_frames(echo)
    echo.add_argument(
        "--rate",
        metavar="HZ",
        type=number(0.0, above=True),
        help="how often (default 1), or how often at most with --on-change (default: all changes)",
    )
    kinds = echo.add_mutually_exclusive_group()
    kinds.add_argument("--on-change", action="store_true", help="print the pose when it changes")
    kinds.add_argument(
        "--estimate",
        action="store_true",
        help="print the pose now and its error (zenoh-tf estimate)",
    )
    estimate.add_options(echo)
    add_max_gap(echo)
    echo.add_argument("--count", metavar="N", type=whole(1), help="end after so many poses")

    wait = commands.add(
        "wait",
        _wait,
        "wait until a lookup succeeds, for scripts",
        "Wait until there is a server, and the pose of SOURCE in TARGET, then print it. Exit code "
        "1 if that takes too long.",
        "zenoh-tf wait map base_link && ./start-navigation",
        "zenoh-tf wait map base_link --for 1min > /dev/null",
    )
    add_frames(wait)
    add_live_at(wait)
    add_duration(wait, "--for", "how long to wait at most (default 10s)", 10.0)


def _echo(args: argparse.Namespace) -> int:
    if args.max_gap_s is not None and (args.on_change or args.estimate):
        args.usage_error("--max-gap belongs to lookups: leave out --on-change and --estimate")
    show: Callable[..., None] = estimate.show_again if args.estimate else output.show_answer
    follow = _changes if args.on_change else _repeated
    with connect(args) as tf, contextlib.closing(follow(tf, args)) as answers:
        for answer in itertools.islice(answers, args.count):
            show(args, tf, answer)
    return 0


def _repeated(tf: TransformClient, args: argparse.Namespace) -> Generator[Any, None, None]:
    """Ask again and again, and report each kind of error when it first occurs."""
    rate_hz = args.rate or 1.0
    reported = ""
    start_s = time.monotonic()
    for tick in itertools.count(1):
        try:
            answer = estimate.ask(tf, args) if args.estimate else _look_up(tf, args)
        except TransformException as error:
            if type(error).__name__ != reported:
                reported = type(error).__name__
                output.report_waiting(error, args.json)
        else:
            reported = ""
            yield answer
        # By the start, so that the pauses do not add up.
        time.sleep(max(0.0, start_s + tick / rate_hz - time.monotonic()))


def _look_up(tf: TransformClient, args: argparse.Namespace) -> StampedTransform:
    return tf.lookup_transform(args.target, args.source, max_gap_s=args.max_gap_s)


def _changes(tf: TransformClient, args: argparse.Namespace) -> Generator[Any, None, None]:
    """Wait for the poses that the server pushes, and report when there is none."""
    is_silent = False
    with tf.watch(args.target, args.source, max_rate_hz=args.rate) as watch:
        for event in watch:
            if event.error is not None and event.reason == "lost":
                output.report_waiting(event.error, args.json)
            elif event.pose is not None and event.reason in ("found", "moved"):
                yield event.pose
            if event.age_s > _SILENT_S + (1 / args.rate if args.rate else 0) and not is_silent:
                silence = f"the server has said nothing for {event.age_s:.0f} s"
                output.report_waiting(ServerUnavailable(silence), args.json)
                is_silent = True
            elif event.age_s < _SILENT_S:
                is_silent = False


def _wait(args: argparse.Namespace) -> int:
    deadline_s = time.monotonic() + args.for_s
    while True:
        left_s = deadline_s - time.monotonic()
        args.timeout = min(args.timeout, max(left_s, _RETRY_S))
        try:
            with connect(args) as tf:
                left_s = max(0.0, deadline_s - time.monotonic())
                answer = tf.lookup_transform(args.target, args.source, args.at, left_s)
                output.show_answer(args, tf, answer)
                return 0
        except ServerUnavailable:
            if time.monotonic() + _RETRY_S >= deadline_s:
                raise
            time.sleep(_RETRY_S)
        except TransformException as error:
            error.add_note(f"zenoh-tf explain {args.target} {args.source} says more")
            raise
