"""What survives a restart: opens the state, restores the tree from it, and keeps it up to date."""

from __future__ import annotations

import argparse
import logging
import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from zenoh_tf import TransformTree, wire
from zenoh_tf._core import TransformRows
from zenoh_tf.errors import TransformException

from ..flag_table import flag
from ..limits import Limits
from .file import StateError, StateFile, Stored, StoredLink, Sync
from .remember import LastPoses
from .static_links import StaticLinks, apply
from .writer import StateWriter

_GROUP: Final = "state (docs/explanation/state.md)"

log = logging.getLogger("zenoh_tf.server.state")


@dataclass(frozen=True)
class StateSettings:
    """What the flags of the state say."""

    folder: Path | None = flag(
        "--state-dir",
        None,
        "keep static links in this folder, one per tree (default: none survives)",
        group=_GROUP,
        type=Path,
        metavar="DIR",
    )
    sync: Sync = flag(
        "--state-sync",
        "full",
        "answer a static write when it survives a power cut (full), or the server's end alone "
        "(normal) (default: %(default)s)",
        group=_GROUP,
        choices=("full", "normal"),
        metavar="WHEN",
    )
    remember: tuple[str, ...] = flag(
        "--remember",
        (),
        "keep the last pose of this dynamic frame, too; repeatable",
        group=_GROUP,
        action="append",
        metavar="FRAME",
    )


def check(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """Exit with status 2 and a message if the flags do not fit together."""
    if options.remember and options.state_dir is None:
        parser.error(f"--remember {options.remember[0]!r} needs --state-dir")


class State:
    """The state of one server's tree. Close it when nothing writes to the tree any more."""

    def __init__(
        self, settings: StateSettings, tree: TransformTree, tree_name: str, limits: Limits
    ) -> None:
        """Restore the tree, which must be empty, and follow it from now on.

        Raises:
            StateError: The state cannot be used, or does not fit into the tree's limits.
        """
        self._stack = ExitStack()
        writer: StateWriter | None = None
        stored = Stored()
        remembered = tuple(dict.fromkeys(settings.remember))
        if settings.folder is not None:
            file = StateFile(settings.folder, tree_name, settings.sync)
            try:
                stored = file.read()
                _restore(tree, stored, settings, file.path)
            except BaseException:
                file.close()
                raise
            writer = StateWriter(file)
            self._stack.callback(writer.close)
        self.links = StaticLinks(tree, limits, writer, stored, remembered)
        if writer is not None:
            poses = LastPoses(tree, remembered, self.links, writer, stored)
            self._stack.callback(poses.close)

    def close(self) -> None:
        """Store what is not stored yet. May be called again."""
        self._stack.close()


def _restore(tree: TransformTree, stored: Stored, settings: StateSettings, path: Path) -> None:
    """Commit what is stored to an empty tree, each link as its authority."""
    by_authority: dict[str, dict[str, StoredLink]] = {}
    for child, link in stored.static_links.items():
        by_authority.setdefault(link.authority, {})[child] = link
    try:
        for authority, links in by_authority.items():
            apply(tree, _commit(links, authority, static=True))
    except TransformException as error:
        raise StateError(f"the static links of {path} do not fit into the tree: {error}") from error
    poses = _restore_last_poses(tree, stored, settings)
    log.info(
        "restored %d static links and %d last poses: %s", len(stored.static_links), poses, path
    )


def _restore_last_poses(tree: TransformTree, stored: Stored, settings: StateSettings) -> int:
    """Commit the last poses that are still valid. Returns how many."""
    restored = 0
    for frame in settings.remember:
        link = stored.last_poses.get(frame)
        if link is None or frame in stored.static_links:
            continue
        if link.stamp_ns > time.time_ns():
            # Newer samples would be dropped as too old.
            log.warning("last pose of %r left out: its stamp is ahead of this clock", frame)
            continue
        try:
            apply(tree, _commit({frame: link}, link.authority, static=False))
        except TransformException as error:  # it was stored up to a second before the static links
            log.warning("last pose of %r left out: %s", frame, error)
            continue
        restored += 1
    return restored


def _commit(links: dict[str, StoredLink], authority: str, *, static: bool) -> wire.Commit:
    rows = ((link.parent, child, link.stamp_ns, link.pose) for child, link in links.items())
    return wire.Commit(TransformRows.of_tuples(rows), authority, static)
