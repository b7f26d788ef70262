"""What a package index shows, the changelog, and that each make target named somewhere exists."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from typing import Any

from .repository import Repository, Violation

REPOSITORY = "https://github.com/zenoh-tf/zenoh-tf"
RAW = "https://raw.githubusercontent.com/zenoh-tf/zenoh-tf"
#: They need no words in CONTRIBUTING.md.
UNDOCUMENTED = {"help", "clean"}
LINKS = re.compile(r"(!?)\[[^\]]*\]\(([^)]+)\)|(?:src|srcset|href)=\"([^\"]+)\"")


def project(repository: Repository) -> dict[str, Any]:
    found: dict[str, Any] = tomllib.loads(repository.text("pyproject.toml"))
    return found


def make_targets(repository: Repository) -> Iterator[Violation]:
    """CONTRIBUTING.md explains each target; pages and workflows name only those that exist."""
    targets = set(re.findall(r"^([a-z0-9-]+):.*##", repository.text("Makefile"), re.M))
    named = set(_named(repository.text("CONTRIBUTING.md")))
    for target in sorted(targets - UNDOCUMENTED - named):
        problem = f"explain make {target} in CONTRIBUTING.md"
        yield repository.at("Makefile", f"\n{target}:", problem)
    for path in repository.pages():
        for number, line in repository.lines(path):
            for target in set(re.findall(r"`make ([a-z0-9-]+)", line)) - targets:
                yield Violation(path, number, f"there is no make {target}")
    for path in [*repository.files(".yml", under=[".github/workflows"]), ".ci/run"]:
        for number, line in repository.lines(path):
            call = re.match(r"^ *(?:- run: |run: )?make ((?:[a-z0-9-]+ ?)+)", line)
            if path.endswith("nightly.yml"):  # its matrix lists targets
                call = re.match(r"^ {10}- ([a-z0-9-]+)", line)
            for target in set(call[1].split() if call else ()) - targets:
                yield Violation(path, number, f"there is no make {target}")


def _named(text: str) -> list[str]:
    return re.findall(r"\bmake ([a-z0-9]+(?:-[a-z0-9]+)*)(?=[`\s.,;]|$)", text)


def readme(repository: Repository) -> Iterator[Violation]:
    """README.md as a package index shows it: absolute links that lead somewhere."""
    text = repository.text("README.md")
    hooks = project(repository)["tool"]["hatch"]["metadata"]["hooks"]["fancy-pypi-readme"]
    for rule in hooks["substitutions"]:
        text = re.sub(rule["pattern"], rule["replacement"].replace("\\1", r"\g<1>"), text)
    for number, line in enumerate(text.splitlines(), 1):
        for is_picture, target, attribute in LINKS.findall(line):
            link = target or attribute
            if not link.startswith(("https://", "#")):
                yield Violation("README.md", number, f"{link} works only in the repository")
            elif is_picture and not link.startswith(f"{RAW}/main/docs/"):
                yield Violation("README.md", number, f"{link} is no raw file of docs/")
            for prefix in (f"{REPOSITORY}/blob/main/", f"{RAW}/main/"):
                path = link.removeprefix(prefix).partition("#")[0]
                if link.startswith(prefix) and not repository.exists(path):
                    yield Violation("README.md", number, f"{link} leads nowhere")


def metadata(repository: Repository) -> Iterator[Violation]:
    """The package names its authors, and the changelog its version."""
    fields = project(repository)["project"]
    if not fields.get("authors"):
        yield repository.at("pyproject.toml", "[project]", "add authors")
    if f"## [{fields['version']}]" not in repository.text("CHANGELOG.md"):
        yield Violation("CHANGELOG.md", 1, f"add a section for version {fields['version']}")


def extras(repository: Repository) -> Iterator[Violation]:
    """Commands and messages name only extras that there are, installed from the checkout."""
    known = project(repository)["project"]["optional-dependencies"].keys()
    for path in repository.pages():
        for number, line in repository.lines(path):
            for place, names in re.findall(r"pip install [\"']?([\w.-]*)\[([\w,]+)\]", line):
                if missing := set(names.split(",")) - known:
                    yield Violation(path, number, f"there is no extra {', '.join(missing)}")
                if place == "zenoh-tf":
                    problem = f"zenoh-tf is on no index yet: pip install '.[{names}]'"
                    yield Violation(path, number, problem)
