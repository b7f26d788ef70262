"""What pages say of files: links, files that they name, examples that they show, made pages."""

from __future__ import annotations

import importlib
import posixpath
import re
from collections.abc import Iterator

import zenoh_tf
import zenoh_tf_client
from bench.results import MARKER, Results
from scripts import folders
from tests.mutation import fault_page
from zenoh_tf.doctor import __main__ as doctor
from zenoh_tf.introspection import metric_table
from zenoh_tf_server import flags, limits

from .repository import Repository, Violation

TUTORIAL = "docs/tutorial/README.md"
#: Example -> the page that shows it as it is.
SHOWN = {
    "first.py": "README.md",
    "sensor.py": TUTORIAL,
    "client.py": TUTORIAL,
    "transaction.py": TUTORIAL,
    "async_client.py": "docs/how-to/asyncio.md",
    "from_tf2.py": "docs/how-to/from-tf2.md",
    "message_filter.py": "docs/how-to/from-tf2.md",
}
MAX_EXAMPLE_LINES = 40
PACKAGES = ("zenoh_tf", "server/zenoh_tf_server", "client")
ARCHITECTURE = "docs/explanation/architecture.md"
NAMING_FILES = (ARCHITECTURE, "docs/explanation/concurrency.md", "docs/reference/glossary.md")
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


def architecture(repository: Repository) -> Iterator[Violation]:
    """Each table of the architecture page names its folder's files, or a folder they are in."""
    page = ARCHITECTURE
    tables: dict[str, set[str]] = {}
    folder = ""
    for _, line in repository.lines(page):
        if header := re.match(r"\| `([\w/]+/)` \| subject", line):
            folder = header[1]
        if folder and line.startswith("|"):
            names = re.findall(r"([\w/]+)(?:\.(?:pyi?|hpp|cpp)|/)(?![\w/])", line)
            tables.setdefault(folder, set()).update(name.rstrip("/") for name in names)
    for path in repository.files(".py", ".pyi", ".hpp", ".cpp", under=PACKAGES):
        folder = max((each for each in tables if path.startswith(each)), key=len, default="")
        parts = re.sub(r"\.\w+$", "", path.removeprefix(folder)).split("/")
        if not tables.get(folder, set()) & set(parts) and not parts[-1].startswith("__"):
            yield Violation(page, 1, f"add {path} to the table of {folder or 'its folder'}")


def shown_examples(repository: Repository) -> Iterator[Violation]:
    """Examples are short, and pages show them as they are."""
    for name, page in SHOWN.items():
        path = f"examples/{name}"
        text = repository.text(path)
        if len(text.splitlines()) >= MAX_EXAMPLE_LINES:
            problem = f"has {MAX_EXAMPLE_LINES} lines or more: a page shows it"
            yield Violation(path, MAX_EXAMPLE_LINES, problem)
        if f"```python\n{text}```" not in repository.text(page):
            yield Violation(page, 1, f"shows {path} as it is not: copy it again")
    for path in repository.files(".py", under=["examples/tf2_tutorials"]):
        for number, line in repository.lines(path):
            # All else is as in a script for tf2.
            if "zenoh" in line and not re.match(r"from zenoh_tf_client\.tf2[\w.]* import ", line):
                yield Violation(path, number, "only import lines may differ from tf2's tutorial")


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


def made_pages(repository: Repository) -> Iterator[Violation]:
    """Pages that are made from tables are current, or their table is."""
    metrics = "zenoh_tf.introspection.metric_table"
    for page, made, command in (
        ("docs/reference/limits.md", list(limits.table()), "zenoh_tf_server.limits"),
        ("docs/reference/server.md", list(flags.page()), "zenoh_tf_server.flags"),
        ("docs/reference/metrics.md", list(metric_table.table()), metrics),
        ("docs/reference/doctor.md", list(doctor.page()), "zenoh_tf.doctor"),
        ("tests/faults.md", list(fault_page.page()), "tests.mutation.fault_page"),
        ("docs/figures/folders.svg", list(folders.picture()), "scripts.folders"),
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


def documented_calls(repository: Repository) -> Iterator[Violation]:
    """Calls and imports in docs/how-to/from-tf2.md are of methods and names that exist."""
    page = "docs/how-to/from-tf2.md"
    pattern = r"\b(tf|X|Transform|TransformTree)\.(\w+)\(([^`]*)\)"
    for number, line in repository.lines(page):
        for code in re.findall(r"`([^`\n]+)`", line):
            for owner, method, arguments in re.findall(pattern, code):
                kind = zenoh_tf_client.TransformClient if owner == "tf" else zenoh_tf.Transform
                function = getattr(kind, method, None)
                names = getattr(getattr(function, "__code__", None), "co_varnames", ())
                if function is None:
                    yield Violation(page, number, f"{kind.__name__} has no method {method}")
                for name in re.findall(r"(\w+)=", arguments) if owner == "tf" else ():
                    if name not in names:
                        yield Violation(page, number, f"{method} has no argument {name}")
            imported = re.match(r"from (zenoh_tf_client\.tf2[\w.]*) import ([\w, ]+)$", code)
            for name in imported[2].split(", ") if imported else ():
                if imported and not _has(imported[1], name):
                    yield Violation(page, number, f"{imported[1]} has no {name}")


def _has(module: str, name: str) -> bool:
    try:
        return hasattr(importlib.import_module(module), name)
    except ModuleNotFoundError:
        return False
