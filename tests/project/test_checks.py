"""Each check of ``make lint`` finds a violation that is planted in a copy of the texts."""

from __future__ import annotations

import re

from scripts.checks import CHECKS
from scripts.checks.repository import Repository

CLIENT, AIO = "client/zenoh_tf_client", "client/zenoh_tf_client/aio"
CORE = "zenoh_tf/core"
HOW, REF, WHY = "docs/how-to", "docs/reference", "docs/explanation"
DASHBOARD = "docker/grafana/dashboard.json"
#: Check, file, a pattern in it, what takes its place, and a part of the report.
PLANTED: list[tuple[str, str, str, str, str]] = [
    ("made_files", f"{AIO}/lookups.py", "def deskew", "def skew", "lookups.py:1: differs"),
    ("made_files", f"{CLIENT}/batch.py", r"\Z", "x = 1\n", f"{CLIENT}/batch.py"),
    ("made_files", f"{AIO}/batch.py", r"\Z", "x = 1\n", f"{CLIENT}/batch.py"),
    ("made_files", f"{AIO}/batch.py", r"\Z", "_T: AsyncAny\n", f"{CLIENT}/batch.py"),
    ("made_files", f"{AIO}/batch.py", r"\Z", "Awaitable\n", "still have 'Awaitable'"),
    ("imports", "zenoh_tf/_net/keys.py", r"\A", "import yaml\n", "imports yaml"),
    ("make_targets", ".ci/run", r"make lint", "make nonsense", "there is no make nonsense"),
    ("make_targets", ".github/workflows/nightly.yml", "- fuzz", "- fuss", "no make fuss"),
    ("make_targets", f"{WHY}/testing.md", "`make fuzz`", "`make fuss`", "there is no make fuss"),
    ("links", f"{WHY}/state.md", r"\]\([a-z./-]+\.md", "](nowhere.md", "nowhere.md leads nowhere"),
    ("links", f"{HOW}/from-tf2.md", "#call-by-call", "#calls", "has no heading #calls"),
    (
        "named_files",
        f"{REF}/glossary.md",
        "`records/frame.hpp`",
        "`frames.hpp`",
        "names frames.hpp",
    ),
    ("core_folders", f"{CORE}/names/hash.hpp", "base/comp", 'commits/plan.hpp"//', "not commits"),
    ("core_folders", f"{CORE}/names/hash.hpp", "base/compiler", "compiler", "from the core's root"),
    ("core_folders", f"{CORE}/records/layout.hpp", '#include "names/reader.hpp"', "", "any more"),
    ("core_folders", f"{CORE}/extra/new.hpp", r"\Z", "// New.\n", "extra is no folder"),
    ("api_reference", f"{REF}/api/client.md", r"::: \S+Transaction\n", "", "Transaction"),
    ("made_pages", f"{REF}/limits.md", "1,048,576", "1,048,577", f"{REF}/limits.md:26"),
    (
        "measured_numbers",
        f"{WHY}/comparison.md",
        "(bench:reads/latest common time/bare query/us_per_call -->)",
        r"\g<1>9",
        "differs from bench",
    ),
    ("measured_numbers", f"{HOW}/mirrors.md", r"takes (?=<!--)", "\n", "begins a line"),
    ("queries", DASHBOARD, "zenoh_tf_frames", "zenoh_tf_fames", "no metric zenoh_tf_fames"),
    ("flags", f"{HOW}/view.md", r"zenoh-tf view ", "zenoh-tf view --loop ", "has no flag --loop"),
    ("flags", f"{WHY}/clocks.md", "`--cache-time`", "`--cash-time`", "flag --cash-time"),
    ("limits", f"{WHY}/state.md", "--limit frames", "--limit frame", "there is no limit frame"),
    ("defaults", f"{WHY}/clocks.md", "default 3600", "default 60", "of --max-future-s is 3600"),
]


def test_each_check_finds_what_is_planted() -> None:
    by_name = {check.__name__: check for check in CHECKS}
    clean = Repository()
    for name, path, pattern, replacement, report in PLANTED:
        text, found = re.subn(pattern, replacement, clean.text(path), count=1)
        assert found, f"{path} has no {pattern!r} to replace"
        planted = Repository({path: text})
        reports = [str(each) for each in by_name[name](planted)]
        assert any(report in each for each in reports), (name, path, replacement, reports)


def test_each_check_has_something_planted() -> None:
    assert {check.__name__ for check in CHECKS} == {name for name, *_ in PLANTED}
