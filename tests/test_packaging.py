"""What a package index shows, and that every make target which is named somewhere exists."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
from scikit_build_core.metadata.fancy_pypi_readme import dynamic_metadata

ROOT = Path(__file__).resolve().parent.parent
REPOSITORY = "https://github.com/zenoh-tf/zenoh-tf"
RAW = "https://raw.githubusercontent.com/zenoh-tf/zenoh-tf"
#: They need no words in CONTRIBUTING.md.
UNDOCUMENTED = {"help", "clean"}


def _targets() -> set[str]:
    return set(re.findall(r"^([a-z-]+):.*##", (ROOT / "Makefile").read_text(), re.MULTILINE))


def _named_targets(path: Path) -> set[str]:
    return set(re.findall(r"\bmake ([a-z]+(?:-[a-z]+)*)(?=[`\s.,;]|$)", path.read_text()))


def test_contributing_explains_every_make_target() -> None:
    assert _targets() - UNDOCUMENTED <= _named_targets(ROOT / "CONTRIBUTING.md")


@pytest.mark.parametrize("workflow", sorted((ROOT / ".github/workflows").glob("*.yml")))
def test_workflows_call_make_targets_that_exist(workflow: Path) -> None:
    calls = re.findall(r"^ *(?:- run: )?make ([a-z-]+)", workflow.read_text(), re.MULTILINE)
    assert calls
    assert set(calls) <= _targets()


@pytest.fixture
def readme(monkeypatch: pytest.MonkeyPatch) -> str:
    """README.md as the metadata of a wheel have it."""
    monkeypatch.chdir(ROOT)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    field = dynamic_metadata("readme", {}, project)
    assert isinstance(field, dict)
    return field["text"]


def test_links_of_the_readme_are_absolute_and_lead_somewhere(readme: str) -> None:
    links = re.findall(r"\]\(([^)]+)\)|(?:src|srcset|href)=\"([^\"]+)\"", readme)
    assert links
    for link in map("".join, links):
        assert link.startswith(("https://", "#")), f"{link} works only in the repository"
        for prefix in (f"{REPOSITORY}/blob/main/", f"{RAW}/main/"):
            if link.startswith(prefix):
                path = link.removeprefix(prefix).partition("#")[0]
                assert (ROOT / path).exists(), f"{link} leads nowhere"


def test_pictures_of_the_readme_are_raw_files(readme: str) -> None:
    pictures = re.findall(r"!\[[^\]]*\]\(([^)]+)\)", readme)
    assert pictures
    assert all(picture.startswith(f"{RAW}/main/docs/") for picture in pictures)
