"""What is made from something else is current: the synchronous client, pages of tables, numbers."""

from __future__ import annotations

from collections.abc import Iterator

from bench.results import MARKER, Results
from tests.mutation import fault_page
from zenoh_tf.introspection import metric_table
from zenoh_tf_server import flags, limits
from zenoh_tf_tools.doctor import __main__ as doctor

from .. import api_names, sync_client
from .repository import Repository, Violation


def made_files(repository: Repository) -> Iterator[Violation]:
    """The files that scripts/sync_client.py makes are current, and each of its rules applies."""
    try:
        for path, _ in sync_client.stale(repository.text):
            yield Violation(path, 1, "differs from what its source gives: run make format")
    except (ValueError, SyntaxError) as error:
        yield Violation("scripts/sync_client.py", 1, str(error))


def made_pages(repository: Repository) -> Iterator[Violation]:
    """Pages that are made from tables are current, or their table is."""
    metrics = "zenoh_tf.introspection.metric_table"
    for page, made, command in (
        ("docs/reference/limits.md", list(limits.table()), "zenoh_tf_server.limits"),
        ("docs/reference/server.md", list(flags.page()), "zenoh_tf_server.flags"),
        ("docs/reference/metrics.md", list(metric_table.table()), metrics),
        ("docs/reference/doctor.md", list(doctor.page()), "zenoh_tf_tools.doctor"),
        ("docs/reference/api/README.md", list(api_names.table()), "scripts.api_names"),
        ("tests/faults.md", list(fault_page.page()), "tests.mutation.fault_page"),
    ):
        is_table = made[0].startswith("|")
        there = [each for each in repository.lines(page) if each[1][:1] == "|" or not is_table]
        if [line for _, line in there] != made:
            pairs = zip(there, made, strict=False)
            number = next((n for (n, line), other in pairs if line != other), 1)
            problem = f"differs from what .venv/bin/python -m {command} prints"
            yield Violation(page, number, problem)


def measured_numbers(repository: Repository) -> Iterator[Violation]:
    """Measured numbers in pages are those of bench/results."""
    results = Results()
    for page in repository.pages():
        text = repository.text(page)
        for match in MARKER.finditer(text):
            key, number = match["key"], text.count("\n", 0, match.start()) + 1
            try:
                measured = results.number(key)
            except KeyError:
                yield Violation(page, number, f"no result has the key {key}")
                continue
            if match["text"] != measured:
                yield Violation(page, number, f"{key} differs from bench/results: make figures")
            elif text[: match.start()].endswith("\n") and "\n" not in match["text"]:
                yield Violation(page, number, f"{key} begins a line, so a paragraph ends before it")
