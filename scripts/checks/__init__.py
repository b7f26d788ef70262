"""All checks, each a function from the repository to its violations."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from . import core_folders, documented, imports, made_files, monitoring, pages
from .repository import Repository, Violation

CHECKS: tuple[Callable[[Repository], Iterator[Violation]], ...] = (
    *(imports.imports, core_folders.core_folders),
    *(made_files.made_files, made_files.made_pages, made_files.measured_numbers),
    *(pages.links, pages.named_files, pages.api_reference, pages.make_targets),
    *(documented.flags, documented.limits, documented.defaults, monitoring.queries),
)
