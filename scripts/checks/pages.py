"""What pages say of files: links, files that they name, public names, make targets."""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterator

import zenoh_tf
import zenoh_tf_client

from .repository import Repository, Violation

NAMING_FILES = (
    "docs/explanation/architecture.md",
    "docs/explanation/concurrency.md",
    "docs/reference/glossary.md",
)
FILE_NAME = re.compile(r"[\w/]+\.(?:pyi?|hpp|cpp)\b")


def links(repository: Repository) -> Iterator[Violation]:
    """Relative links and pictures lead to files, and anchors to headings."""
    for page in repository.pages():
        for number, line in repository.lines(page):
            for target in re.findall(r"\]\(([^)]+)\)|src=\"([^\"]+)\"", line):
                path, _, anchor = "".join(target).partition("#")
                if "://" in path:
                    continue
                file = posixpath.normpath(posixpath.join(posixpath.dirname(page), path))
                file = file if path else page
                if not repository.exists(file):
                    yield Violation(page, number, f"{path} leads nowhere")
                elif anchor and anchor not in _anchors(repository.text(file)):
                    yield Violation(page, number, f"{file} has no heading #{anchor}")


def _anchors(text: str) -> set[str]:
    headings = re.findall(r"^#+ (.*)$", text, re.M)
    plain = (re.sub(r"\[([^\]]*)\]\([^)]*\)|[`*]", r"\1", heading) for heading in headings)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in plain}


def named_files(repository: Repository) -> Iterator[Violation]:
    """Pages name source files that exist."""
    files = repository.files(".py", ".pyi", ".hpp", ".cpp")
    for page in NAMING_FILES:
        for number, line in repository.lines(page):
            for name in FILE_NAME.findall(line):
                if not any(f"/{file}".endswith(f"/{name}") for file in files):
                    yield Violation(page, number, f"names {name}, which does not exist")


def api_reference(repository: Repository) -> Iterator[Violation]:
    """Every public name is in the API reference."""
    folder = "docs/reference/api"
    pages = "".join(repository.text(page) for page in repository.files(".md", under=[folder]))
    shown = set(re.findall(r"^::: (\S+)$", pages, re.M))
    for package in (zenoh_tf, zenoh_tf_client):
        for name in package.__all__:
            full = f"{package.__name__}.{name}"
            if full in shown or name.startswith("_") or hasattr(zenoh_tf.errors, name):
                continue
            yield Violation(f"{folder}/README.md", 1, f"add ::: {full} to a page of {folder}")


def make_targets(repository: Repository) -> Iterator[Violation]:
    """Pages and workflows name only targets that exist."""
    targets = set(re.findall(r"^([a-z0-9-]+):.*##", repository.text("Makefile"), re.M))
    workflows = repository.files(".yml", under=[".github/workflows"])
    for path in [*repository.pages(), *workflows, ".ci/run"]:
        pattern = r"^ *(?:- )?(?:run: )?make (.+)"
        if path.endswith(".md"):
            pattern = r"`make ([a-z0-9 -]+)"
        elif path.endswith("nightly.yml"):  # its matrix lists targets
            pattern = r"^ {10}- ([a-z0-9-]+)"
        for number, line in repository.lines(path):
            for call in re.findall(pattern, line):
                for target in set(re.findall(r"(?<!\S)[a-z0-9-]+(?!\S)", call)) - targets:
                    yield Violation(path, number, f"there is no make {target}")
