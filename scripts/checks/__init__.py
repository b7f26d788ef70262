"""All checks, each a function from the repository to its violations."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from . import (
    clocks,
    core_folders,
    docstrings,
    documented,
    made_files,
    monitoring,
    packaging,
    pages,
    source_rules,
    suite,
)
from .repository import Repository, Violation

CHECKS: tuple[Callable[[Repository], Iterator[Violation]], ...] = (
    docstrings.docstrings,
    *(source_rules.imports, source_rules.sizes, source_rules.actors, source_rules.configurations),
    *(source_rules.folders, source_rules.functions, source_rules.words, source_rules.lock_order),
    *(core_folders.core_folders, made_files.made_files),
    *(packaging.make_targets, packaging.readme, packaging.metadata, packaging.extras),
    *(pages.links, pages.named_files, pages.architecture, pages.shown_examples),
    *(pages.api_reference, pages.made_pages, pages.measured_numbers, pages.documented_calls),
    *(monitoring.queries, monitoring.panels, monitoring.compose_files, monitoring.scraping),
    *(documented.flags, documented.limits, documented.defaults, documented.enumerations),
    *(suite.conformance, clocks.clocks),
)
