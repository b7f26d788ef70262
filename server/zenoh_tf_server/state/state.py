"""What survives a restart: opens the state, restores the tree from it, and keeps it up to date."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from zenoh_tf import TransformTree, wire
from zenoh_tf._core import TransformRows
from zenoh_tf.errors import TransformException

from ..flag_table import flag
from ..limits import Limits
from .file import StateError, StateFile, Stored, StoredLink, Sync
from .static_links import StaticLinks
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


class StoredState:
    """The state of one server's tree. Close it when nothing writes to the tree any more."""

    def __init__(
        self, settings: StateSettings, tree: TransformTree, tree_name: str, limits: Limits
    ) -> None:
        """Restore the tree, which must be empty, and follow it from now on.

        Raises:
            StateError: The state cannot be used, or does not fit into the tree's limits.
        """
        self._writer: StateWriter | None = None
        stored = Stored()
        if settings.folder is not None:
            file = StateFile(settings.folder, tree_name, settings.sync)
            try:
                stored = file.read()
                _restore(tree, stored, file.path)
            except BaseException:
                file.close()
                raise
            self._writer = StateWriter(file)
        self.links = StaticLinks(tree, limits, self._writer, stored)

    def close(self) -> None:
        """Store what is not stored yet. May be called again."""
        writer, self._writer = self._writer, None
        if writer is not None:
            writer.close()


def _restore(tree: TransformTree, stored: Stored, path: Path) -> None:
    """Commit what is stored to an empty tree, each link as its authority."""
    by_authority: dict[str, dict[str, StoredLink]] = {}
    for child, link in stored.static_links.items():
        by_authority.setdefault(link.authority, {})[child] = link
    try:
        for authority, links in by_authority.items():
            rows = ((x.parent, child, x.stamp_ns, x.pose) for child, x in links.items())
            wire.Commit(TransformRows.of_tuples(rows), authority, static=True).apply(tree)
    except TransformException as error:
        raise StateError(f"the static links of {path} do not fit into the tree: {error}") from error
    log.info("restored %d static links: %s", len(stored.static_links), path)
