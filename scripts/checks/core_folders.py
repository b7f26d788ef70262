"""Which folder of the core may include which.

The core's folders are floors: `MAY_INCLUDE` names them from the ground up, so a folder includes
only those before it. The files at the root are floors, too: ``tree_state.hpp`` between the folders
that it is made of and those that work on it, ``tree.hpp`` on top. An include is written from the
core's root.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from .repository import Repository, Violation

CORE = "zenoh_tf/core/"
#: Each folder, or file at the root, with what it may include beside itself.
MAY_INCLUDE: dict[str, tuple[str, ...]] = {
    "system": (),
    "base": (),
    "geometry": ("base",),
    "records": ("system", "base", "geometry"),
    "histories": ("geometry", "records"),
    "names": ("base", "records"),
    "reads": ("base", "geometry", "records", "histories"),
    "estimates": ("base", "geometry", "reads"),
    "waiting": ("system", "base", "records", "reads"),
    "tree_state.hpp": ("system", "base", "records", "names", "reads", "waiting"),
    "tree_state.cpp": ("system", "tree_state.hpp"),
    "modes": ("base", "tree_state.hpp"),
    "shared": ("system", "base", "records", "reads", "estimates", "tree_state.hpp"),
    "lookups": ("system", "base", "reads", "estimates", "tree_state.hpp", "modes", "shared"),
    "commits": ("system", "base", "records", "histories", "tree_state.hpp", "modes"),
    "messages": ("geometry", "reads", "commits"),
    "replication": ("base", "records", "histories", "tree_state.hpp", "commits", "messages"),
    "tree.hpp": ("estimates", "tree_state.hpp", "lookups", "commits"),
    "tree.cpp": ("tree.hpp",),
    "by_name": ("system", "base", "names", "reads", "shared", "tree.hpp"),
}
#: Files that include one of a folder above theirs, and why.
EXCEPTIONS = {
    # The layout has the entries of names among its records; a table of names is made in a region.
    ("records/layout.hpp", "names/reader.hpp"),
}
INCLUDE = re.compile(r'^#include "([^"]+)"')


def core_folders(repository: Repository) -> Iterator[Violation]:
    """Each include of the core leads to the same folder or one that `MAY_INCLUDE` allows."""
    folders = list(MAY_INCLUDE)
    for folder, allowed in MAY_INCLUDE.items():
        for other in allowed:
            if folders.index(other) >= folders.index(folder):
                yield _at_rule(repository, folder, f"{folder} is not above {other}: name it later")
    seen: set[tuple[str, str]] = set()
    for path in repository.files(".hpp", ".cpp", under=[CORE]):
        file = path.removeprefix(CORE)
        folder = _folder(file)
        if folder not in MAY_INCLUDE:
            yield Violation(path, 1, f"{folder} is no folder of the core: add it to MAY_INCLUDE")
            continue
        for number, line in repository.lines(path):
            if not (found := INCLUDE.match(line)):
                continue
            included = found[1]
            other = _folder(included)
            if other not in MAY_INCLUDE or not repository.exists(CORE + included):
                yield Violation(path, number, f"write {included} from the core's root")
            elif (file, included) in EXCEPTIONS:
                seen.add((file, included))
            elif other != folder and other not in MAY_INCLUDE[folder]:
                problem = f"{folder} may include {_list(MAY_INCLUDE[folder])}, not {other}"
                yield Violation(path, number, problem)
            else:
                seen.add((folder, other))
    for folder, allowed in MAY_INCLUDE.items():
        for other in allowed:
            if (folder, other) not in seen:
                yield _at_rule(
                    repository, f'"{folder}": (', f"{folder} includes no {other} any more"
                )
    for file, included in sorted(EXCEPTIONS - seen):
        yield _at_rule(repository, f'("{file}"', f"{file} does not include {included} any more")


def _folder(file: str) -> str:
    """The folder of a file; a file at the root is a folder of its own."""
    return file.partition("/")[0]


def _list(folders: tuple[str, ...]) -> str:
    return ", ".join(folders) or "nothing"


def _at_rule(repository: Repository, part: str, problem: str) -> Violation:
    return repository.at("scripts/checks/core_folders.py", part, problem)
