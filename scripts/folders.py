"""Draws the folders and which of them imports which: ``python -m scripts.folders >
docs/figures/folders.svg``.

A folder here may be a module beside folders. It stands above all that it imports. An arrow that
follows from two others is left out, and so are the exceptions that the contracts name. `make lint`
checks that the picture is current.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import grimp

from scripts.checks.core_folders import MAY_INCLUDE

ROOT = Path(__file__).resolve().parents[1]
#: Modules that start a program, or that nearly all import, would only add lines.
LEFT_OUT = {"__main__", "py", "errors", "text", "_core"}
TITLES = {
    "zenoh_tf_tools": "zenoh_tf_tools: command line, viewer",
    "zenoh_tf_client": "zenoh_tf_client: SDK",
    "zenoh_tf_server": "zenoh_tf_server: service",
    "zenoh_tf": "zenoh_tf: tree, messages",
    "core": "zenoh_tf/core: C++",
}
#: The packages from top to bottom, side by side where they do not know each other.
ROWS = (("zenoh_tf_tools",), ("zenoh_tf_client", "zenoh_tf_server"), ("zenoh_tf", "core"))
PACKAGE_ARROWS = (
    ("zenoh_tf_tools", "zenoh_tf_client"),
    ("zenoh_tf_client", "zenoh_tf"),
    ("zenoh_tf_server", "zenoh_tf"),
    ("zenoh_tf", "core"),
)
CHARACTER, BOX_HEIGHT, GAP, LEVEL, MARGIN = 6.6, 22, 10, 46, 14

Graph = dict[str, set[str]]


class Panel(NamedTuple):
    """A package with its folders: lower left corners of boxes, and their widths."""

    boxes: dict[str, tuple[float, float, float]]
    arrows: list[tuple[str, str]]
    width: float
    height: float


def imports(package: str) -> Graph:
    """Each folder of a Python package, with the folders of it that it imports."""
    graph = grimp.build_graph("zenoh_tf", "zenoh_tf_server", "zenoh_tf_client", "zenoh_tf_tools")
    for importer, imported in _excepted():
        for one in {importer, *graph.find_descendants(importer)}:
            for other in {imported, *graph.find_descendants(imported)}:
                graph.remove_import(importer=one, imported=other)
    folders: Graph = {}
    for child in graph.find_children(package):
        if child.rpartition(".")[2] not in LEFT_OUT:
            folders[child] = set()
    for one in folders:
        for other in folders:
            if one != other and graph.direct_import_exists(
                importer=one, imported=other, as_packages=True
            ):
                folders[one].add(other)
    return {
        _short(folder): {_short(other) for other in others} for folder, others in folders.items()
    }


def _excepted() -> list[tuple[str, str]]:
    """The imports that the contracts name as exceptions."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())
    contracts = settings["tool"]["importlinter"]["contracts"]
    texts = [text for contract in contracts for text in contract.get("ignore_imports", ())]
    return [(text.split(" -> ")[0], text.split(" -> ")[1]) for text in texts]


def includes() -> Graph:
    """Each folder of the core, with those that it includes: `make lint` compares the table."""
    folders: Graph = {}
    for folder, others in MAY_INCLUDE.items():
        name, *included = (each.partition(".")[0] for each in (folder, *others))
        folders[name] = folders.get(name, set()) | {*included} - {name}
    return folders


def reduced(graph: Graph) -> tuple[dict[str, int], list[tuple[str, str]]]:
    """Each folder's level, and the arrows that do not follow from others. An arrow that
    closes a circle is left out; the contracts forbid circles."""
    levels: dict[str, int] = {}
    below: Graph = {}
    open_: list[str] = []

    def visit(folder: str) -> None:
        open_.append(folder)
        below[folder] = set()
        levels[folder] = 0
        for other in sorted(graph[folder] - set(open_)):
            if other not in levels:
                visit(other)
            below[folder] |= {other} | below[other]
            levels[folder] = max(levels[folder], levels[other] + 1)
        open_.pop()

    for folder in sorted(graph):
        if folder not in levels:
            visit(folder)
    arrows = []
    for folder in sorted(graph):
        direct = graph[folder] & below[folder]
        implied = set().union(*(below[other] for other in direct)) if direct else set()
        arrows += [(folder, other) for other in sorted(direct - implied)]
    return levels, arrows


def panel(graph: Graph) -> Panel:
    """Rows of boxes by level; in a row, in the order of what they import."""
    levels, arrows = reduced(graph)
    rows = [
        sorted(folder for folder in graph if levels[folder] == level)
        for level in range(max(levels.values()) + 1)
    ]
    widths = {folder: CHARACTER * len(folder) + 14 for folder in graph}
    row_width = [sum(widths[folder] + GAP for folder in row) - GAP for row in rows]
    width = max(row_width) + 2 * MARGIN
    centre: dict[str, float] = {}
    boxes = {}
    for level, row in enumerate(rows):
        under = {
            folder: [centre[b] for a, b in arrows if a == folder and b in centre] for folder in row
        }
        row.sort(
            key=lambda folder: (
                sum(under[folder]) / len(under[folder]) if under[folder] else 0,
                folder,
            )
        )
        x = (width - row_width[level]) / 2
        for folder in row:
            boxes[folder] = (x, MARGIN + BOX_HEIGHT + level * LEVEL, widths[folder])
            centre[folder] = x + widths[folder] / 2
            x += widths[folder] + GAP
    height = 2 * MARGIN + BOX_HEIGHT + LEVEL * (len(rows) - 1) + BOX_HEIGHT
    return Panel(boxes, arrows, width, height)


def picture() -> Iterator[str]:
    """The lines of the SVG."""
    graphs = {name: includes() if name == "core" else imports(name) for name in TITLES}
    panels = {name: panel(graph) for name, graph in graphs.items()}
    width = max(sum(panels[name].width + 3 * MARGIN for name in row) for row in ROWS) + MARGIN
    places: dict[str, tuple[float, float]] = {}
    y = 2.0 * MARGIN
    for row in ROWS:
        free = width - sum(panels[name].width for name in row)
        x = free / (len(row) + 1)
        for name in row:
            places[name] = (x, y)
            x += panels[name].width + free / (len(row) + 1)
        y += max(panels[name].height for name in row) + 4 * MARGIN
    yield (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {y:.0f}" '
        'font-family="sans-serif" font-size="12">'
    )
    yield "<!-- Made by python -m scripts.folders. -->"
    yield (
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="7" '
        'markerHeight="7" orient="auto"><path d="M0 0 8 4 0 8z" fill="#5a6b7b"/></marker></defs>'
    )
    yield f'<rect width="{width:.0f}" height="{y:.0f}" fill="#ffffff"/>'
    for upper, lower in PACKAGE_ARROWS:
        yield _line(*_between(places, panels, upper, lower), '#35506b" stroke-width="2.5')
    for name, (left, top) in places.items():
        yield from _drawn(panels[name], TITLES[name], left, top)
    yield "</svg>"


def _drawn(one: Panel, title: str, left: float, top: float) -> Iterator[str]:
    yield (
        f'<rect x="{left:.1f}" y="{top:.1f}" width="{one.width:.1f}" height="{one.height:.1f}" '
        'rx="6" fill="#f3f6f9" stroke="#35506b"/>'
    )
    yield f'<text x="{left + 4:.1f}" y="{top - 5:.1f}" font-weight="bold">{title}</text>'
    bottom = top + one.height
    for upper, lower in one.arrows:
        (x, y, width), (to_x, to_y, to_width) = one.boxes[upper], one.boxes[lower]
        start = (left + x + width / 2, bottom - y + BOX_HEIGHT)
        yield _line(*start, left + to_x + to_width / 2, bottom - to_y, "#5a6b7b")
    for folder, (x, y, width) in one.boxes.items():
        yield (
            f'<rect x="{left + x:.1f}" y="{bottom - y:.1f}" width="{width:.1f}" '
            f'height="{BOX_HEIGHT}" rx="4" fill="#ffffff" stroke="#5a6b7b"/>'
        )
        yield (
            f'<text x="{left + x + width / 2:.1f}" y="{bottom - y + 15:.1f}" '
            f'text-anchor="middle">{folder}</text>'
        )


def _between(
    places: dict[str, tuple[float, float]], panels: dict[str, Panel], upper: str, lower: str
) -> tuple[float, float, float, float]:
    """From one package to one below it, or to the one at its right."""
    (x, y), (to_x, to_y) = places[upper], places[lower]
    if y == to_y:
        middle = y + min(panels[upper].height, panels[lower].height) / 2
        return x + panels[upper].width, middle, to_x, middle
    ends = x + panels[upper].width / 2, to_x + panels[lower].width / 2
    return ends[0], y + panels[upper].height, ends[1], to_y - MARGIN


def _line(x: float, y: float, to_x: float, to_y: float, colour: str) -> str:
    return (
        f'<line x1="{x:.1f}" y1="{y:.1f}" x2="{to_x:.1f}" y2="{to_y:.1f}" stroke="{colour}" '
        'marker-end="url(#tip)"/>'
    )


def _short(module: str) -> str:
    return module.rpartition(".")[2]


if __name__ == "__main__":
    print("\n".join(picture()))
