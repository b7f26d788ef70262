"""Which room of the core may include which.

The core's folders are floors: `MAY_INCLUDE` names them from the ground up, so a room includes only
rooms before it. The files at the root are floors, too: ``tree_state.hpp`` between the rooms that
it is made of and those that work on it, ``tree.hpp`` on top. An include is written from the
core's root.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from .repository import Repository, Violation

CORE = "zenoh_tf/core/"
#: Each room, or file at the root, with what it may include beside itself.
MAY_INCLUDE: dict[str, tuple[str, ...]] = {
    "base": (),
    "geometry": ("base",),
    "records": ("base", "geometry"),
    "histories": ("geometry", "records"),
    "names": ("base", "records"),
    "reads": ("base", "geometry", "records", "histories"),
    "estimates": ("base", "geometry", "reads"),
    "waiting": ("base", "records", "reads"),
    "tree_state.hpp": ("base", "records", "names", "reads", "estimates", "waiting"),
    "tree_state.cpp": ("base", "tree_state.hpp"),
    "modes": ("base", "tree_state.hpp"),
    "shared": ("base", "records", "reads", "estimates", "tree_state.hpp"),
    "lookups": ("base", "geometry", "reads", "estimates", "tree_state.hpp", "modes", "shared"),
    "commits": ("base", "records", "histories", "tree_state.hpp", "modes"),
    "replication": ("base", "records", "histories", "tree_state.hpp", "commits"),
    "tree.hpp": ("tree_state.hpp", "lookups", "commits"),
    "tree.cpp": ("tree.hpp",),
}
#: Files that include one of a room above theirs, and why.
EXCEPTIONS = {
    # The layout has the entries of names among its records; a table of names is made in a region.
    ("records/layout.hpp", "names/reader.hpp"),
}
INCLUDE = re.compile(r'^#include "([^"]+)"')


def core_rooms(repository: Repository) -> Iterator[Violation]:
    """Each include of the core leads to the same room or one that `MAY_INCLUDE` allows."""
    rooms = list(MAY_INCLUDE)
    for room, allowed in MAY_INCLUDE.items():
        for other in allowed:
            if rooms.index(other) >= rooms.index(room):
                yield _at_rule(repository, room, f"{room} is not above {other}: name it later")
    seen: set[tuple[str, str]] = set()
    introduced: dict[str, int] = dict.fromkeys(rooms, 0)
    for path in repository.files(".hpp", ".cpp", under=[CORE]):
        file = path.removeprefix(CORE)
        room = _room(file)
        if room not in MAY_INCLUDE:
            yield Violation(path, 1, f"{room} is no room of the core: add it to MAY_INCLUDE")
            continue
        if file.endswith(".hpp") and repository.text(path).startswith(f"// The room `{room}/`: "):
            introduced[room] += 1
            may = f"It may include {_list(MAY_INCLUDE[room])}."
            if f"// {may}\n" not in repository.text(path):
                yield Violation(path, 1, f"say of the room: {may}")
        for number, line in repository.lines(path):
            if not (found := INCLUDE.match(line)):
                continue
            included = found[1]
            other = _room(included)
            if other not in MAY_INCLUDE or not repository.exists(CORE + included):
                yield Violation(path, number, f"write {included} from the core's root")
            elif (file, included) in EXCEPTIONS:
                seen.add((file, included))
            elif other != room and other not in MAY_INCLUDE[room]:
                problem = f"{room} may include {_list(MAY_INCLUDE[room])}, not {other}"
                yield Violation(path, number, problem)
            else:
                seen.add((room, other))
    for room, allowed in MAY_INCLUDE.items():
        for other in allowed:
            if (room, other) not in seen:
                yield _at_rule(repository, f'"{room}": (', f"{room} includes no {other} any more")
        if "." not in room and introduced[room] != 1:
            problem = f"one header of {room}/ begins with: // The room `{room}/`"
            yield Violation(f"{CORE}{room}", 1, problem)
    for file, included in sorted(EXCEPTIONS - seen):
        yield _at_rule(repository, f'("{file}"', f"{file} does not include {included} any more")


def _room(file: str) -> str:
    """The folder of a file; a file at the root is a room of its own."""
    return file.partition("/")[0]


def _list(rooms: tuple[str, ...]) -> str:
    return ", ".join(rooms) or "nothing"


def _at_rule(repository: Repository, part: str, problem: str) -> Violation:
    return repository.at("scripts/checks/core_rooms.py", part, problem)
