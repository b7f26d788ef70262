"""``zenoh-tf view``: the tree in three dimensions, in a browser."""

from __future__ import annotations

import argparse
import contextlib
import math
import sys
from collections.abc import Callable, Generator
from pathlib import Path
from typing import TYPE_CHECKING

from zenoh_tf.text import printable
from zenoh_tf.text.flag_values import whole
from zenoh_tf.text.time_flags import RECORDED_TIMES, recorded_time
from zenoh_tf.urdf.visuals import read_visuals
from zenoh_tf_tools.cli import output
from zenoh_tf_tools.cli import recorded as recordings
from zenoh_tf_tools.cli.arguments import Commands, add_duration, add_listen, add_scene
from zenoh_tf_tools.cli.connection import connect
from zenoh_tf_tools.cli.observations import watch
from zenoh_tf_tools.cli.progress import Progress
from zenoh_tf_tools.doctor import RecordedFacts, TreeFacts
from zenoh_tf_tools.errors import CommandError, extra
from zenoh_tf_tools.viewer.live import LiveSource
from zenoh_tf_tools.viewer.recorded import RecordedSource
from zenoh_tf_tools.viewer.source import ViewedTree

if TYPE_CHECKING:
    from zenoh_tf_tools.viewer.findings import Observe
    from zenoh_tf_tools.viewer.models import Model

#: How long the doctor watches a server's tree before its first judgement.
_OBSERVE_S = 2.0


def add(commands: Commands) -> None:
    view = commands.add(
        "view",
        _view,
        "show the tree in 3D, in a browser",
        "Show the tree in a browser: frames, links, stale ones, and where frames have been. "
        "Without FILE it follows a server through a mirror. Runs until Ctrl-C. Needs the library "
        "of zenoh-tf[viewer], and for FILE those of zenoh-tf[recordings]; nothing comes from the "
        "internet.",
        "zenoh-tf view",
        "zenoh-tf view run.mcap --at +42.4s",
        "zenoh-tf view --fixed base_link --trail 0",
        "zenoh-tf view --urdf robot.urdf",
    )
    recordings.add_optional_file(view)
    view.add_argument(
        "--at",
        metavar="TIME",
        type=recorded_time,
        help=f"where to begin in FILE: {RECORDED_TIMES} (default: its first stamp)",
    )
    add_duration(view, "--stale", "mark links without a sample for this long (default 1s)", 1.0)
    help_ = "how long trails go back (default 10s; of a recording: to its begin)"
    add_duration(view, "--trail", help_)
    view.add_argument(
        "--max-frames",
        metavar="N",
        type=whole(1, 10_000),
        default=1000,
        help="most frames that are drawn (default 1000); the page says how many more there are",
    )
    add_scene(view, None, "one that fits the tree and the zoom")
    add_listen(view, 8080, "if it is in use, the next free one")


def _view(args: argparse.Namespace) -> int:
    if args.at is not None and args.file is None:
        args.usage_error("--at chooses a time of a recording: give its FILE")
    with extra("viewer", "viser"):
        from zenoh_tf_tools.viewer.viewer import (  # noqa: PLC0415 - an optional extra
            Options,
            Viewer,
            close_server,
            open_server,
        )
    trail_s = args.trail_s
    if trail_s is None:
        trail_s = 10.0 if args.file is None else math.inf
    with contextlib.ExitStack() as stack:
        models = _models(args.urdf)
        source, observation = _source(args, stack)
        options = Options(
            stale_s=args.stale_s,
            max_frames=args.max_frames,
            at_ns=_at_ns(args, source),
            fixed=args.fixed,
            axes_m=args.axes,
            trail_s=trail_s,
        )
        server = open_server(args.host, args.port)
        stack.callback(close_server, server)
        port = server.get_port()
        if port != args.port and not args.json:
            print(f"port {args.port} is not free")
        output.announce(args, args.tree if args.file is None else str(args.file), "http", port)
        viewer = Viewer(source, server, options, observation, models)
        stack.callback(viewer.close)
        viewer.run()
    return 0


def _source(args: argparse.Namespace, stack: contextlib.ExitStack) -> tuple[ViewedTree, Observe]:
    """What to show, and what gathers the facts about it for the doctor."""
    if args.file is not None:
        return recorded(args), lambda stopped: _recorded_facts(args, stopped)
    tf = stack.enter_context(connect(args))
    source = LiveSource(stack.enter_context(tf.mirror()))
    return source, lambda _stopped: watch(tf, _OBSERVE_S, args.timeout)


def _recorded_facts(
    args: argparse.Namespace, stopped: Callable[[], bool]
) -> Generator[TreeFacts, None, None]:
    facts = RecordedFacts()
    with recordings.opened(args) as recording:
        for message in recording.messages():
            if stopped():
                break
            facts.add(message.log_ns, message.topic, message.static, message.rows)
    yield facts.facts()


def _models(files: list[Path]) -> list[Model]:
    """The shapes of robots. What cannot be drawn is named on stderr."""
    from zenoh_tf_tools.viewer.models import (  # noqa: PLC0415 - an optional extra
        Model,
        ModelError,
    )

    models = []
    for file in files:
        try:
            visuals = read_visuals(file)
        except OSError as error:
            raise CommandError(f"{file}: {error.strerror or error}") from error
        for visual in visuals:
            try:
                models.append(Model(visual))
            except ModelError as error:
                print(
                    f"zenoh-tf: link {printable(visual.link)}: {printable(str(error))}",
                    file=sys.stderr,
                )
    return models


def _at_ns(args: argparse.Namespace, source: ViewedTree) -> int:
    """The time of a recording to begin at; 0 of a server."""
    range_ns = source.range_ns or (0, 0)
    return recordings.stamp_ns("--at", args.at, range_ns, range_ns[0], inside=True)


def recorded(args: argparse.Namespace) -> RecordedSource:
    """The recording that `args.file` names."""
    with recordings.opened(args) as recording:
        with Progress(recording.message_count, "messages") as progress:
            source = RecordedSource(recording, progress.to)
        recordings.warn(recording)
    return source
