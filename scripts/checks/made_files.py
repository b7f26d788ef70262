"""The synchronous client is made from the asynchronous one, so that it has the same methods; and
some classes from what their methods call, so that these have the same arguments."""

from __future__ import annotations

from collections.abc import Iterator

from .. import sync_client
from .repository import Repository, Violation


def made_files(repository: Repository) -> Iterator[Violation]:
    """The files that scripts/sync_client.py makes are current, and each of its rules applies."""
    try:
        for path, _ in sync_client.stale(repository.text):
            yield Violation(path, 1, "differs from what its source gives: run make format")
    except (ValueError, SyntaxError) as error:
        yield Violation("scripts/sync_client.py", 1, str(error))
