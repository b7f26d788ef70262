"""What the benchmark keeps, under which conditions, and what the documentation quotes of it."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from bench import __main__ as bench
from bench import machine, results
from bench.report import Cell, Report


def written(folder: Path, **header: object) -> results.Results:
    report = Report()
    trials = iter([{"us": 1.0}, {"us": 1234.56}, {"us": 3.0}])
    report.measure([Cell({"case": "a", "system": "ours"}, lambda: next(trials))], 3)
    report.add({"depth": 4, "system": "theirs"}, *[{"rate": 5e6}] * 3)
    report.target("ours", [1.0, 2.5, 9.0], ">=", 2)
    report.target("theirs", [2.04], "<=", 2)
    report.write(folder / "part.json", {"part": "part", "commit": "abc"} | header)
    return results.Results(folder)


def test_results_have_quartiles_by_case(tmp_path: Path) -> None:
    kept = written(tmp_path)
    assert kept.quartiles["part/a/ours/us"] == [2, 3, 619]
    assert kept.quartiles["part/theirs/4/rate"] == [5e6] * 3
    assert [row["trials"] for row in kept.rows("part")] == [3, 3]
    assert [target["reached"] for target in kept.targets()] == [True, False]
    assert kept.quartiles["part/ours"] == [1.75, 2.5, 5.75]


def test_a_busy_or_changed_checkout_keeps_no_results(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "describe", dict)
    monkeypatch.setattr(machine, "commit", lambda: "abc")
    monkeypatch.setattr(machine, "load", lambda: 1.25)
    with pytest.raises(SystemExit, match=r"the load is 1\.25, more than 1"):
        bench._conditions(strict=True)
    assert bench._conditions(strict=False)["load"] == 1.25
    monkeypatch.setattr(machine, "load", lambda: 0.5)
    assert bench._conditions(strict=True)["commit"] == "abc"
    monkeypatch.setattr(machine, "commit", lambda: "abc-dirty")
    with pytest.raises(SystemExit, match="uncommitted changes"):
        bench._conditions(strict=True)


def test_results_of_other_code_make_no_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def git(*command: str) -> str:
        user = ("-c", "user.name=test", "-c", "user.email=test@localhost")
        done = subprocess.run(
            ["git", *user, *command], cwd=tmp_path, check=True, capture_output=True, text=True
        )
        return done.stdout.strip()

    monkeypatch.setattr(machine, "ROOT", tmp_path)
    for name in ("README.md", "docs/page.md", "core.cpp"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("old")
    git("init", "-q")
    git("add", "-A")
    git("commit", "-qm", "measured")
    commit = git("rev-parse", "HEAD")
    assert machine.commit() == commit
    kept = written(tmp_path / "bench/results", commit=commit)
    (tmp_path / "docs/page.md").write_text("new")
    assert machine.commit() == commit
    kept.require_current()
    (tmp_path / "core.cpp").write_text("new")
    assert machine.commit() == f"{commit}-dirty"
    git("commit", "-qam", "changed")
    with pytest.raises(SystemExit, match=r"core\.cpp"):
        kept.require_current()
    with pytest.raises(SystemExit, match="git diff"):
        machine.changed_since("0" * 40)


def test_pages_take_their_numbers_from_the_results(tmp_path: Path) -> None:
    about = {"load": 0.5, "background_cores": 0, "date": "", "seconds": 60}
    kept = written(tmp_path, machine={"cpu": "CPU", "cores": "2"}, **about)
    page = "<!-- bench:part/a/ours/us;range -->{}<!-- / --> µs,\n<!-- bench:machine -->{}<!-- / -->"
    assert kept.filled(page.format(7, "\nx\n")) == page.format("3 (2 to 619)", "2 cores of an CPU")
    assert kept.number("part/theirs/4/rate;M") == "5"
    assert "| `part` | theirs | &lt;= 2 | 2.04 (2.04 to 2.04) |" in kept.number("missed-table")
    with pytest.raises(KeyError, match="part/b"):
        kept.number("part/b")


@pytest.mark.timeout(180)  # it loads Matplotlib
def test_kept_results_are_small_and_make_all_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plots = pytest.importorskip("bench.figures")
    kept = results.Results()
    assert kept.parts.keys() == bench.PARTS.keys()
    assert all(path.stat().st_size < 25_000 for path in results.FOLDER.glob("*.json"))
    plots.draw(kept, tmp_path)
    sizes = {path.name: path.stat().st_size for path in tmp_path.glob("*.svg")}
    assert len(sizes) == 7
    assert max(sizes.values()) < 30_000, sizes
