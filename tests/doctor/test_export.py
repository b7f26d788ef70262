"""The tree as text, DOT and Mermaid."""

from __future__ import annotations

import html
import re
import shutil
import subprocess
import time
from collections.abc import Callable
from xml.etree import ElementTree

import pytest

from zenoh_tf import FrameInfo, StampedTransform, Transform, TransformTree, export

NOW_NS = 1_700_000_000_000_000_000
S = 10**9

#: Names that mean something to a terminal, to Graphviz, to Mermaid, to Markdown or to HTML.
HOSTILE = [
    'a"b',
    "new\nline",
    "\x1b[2J\x01",
    "back\\",
    "\\N \\G \\l",
    "<script>alert(1)</script>",
    "&lt;",
    "#quot;",
    "#35;",
    "&#35;",
    "`**bold** _it_`",
    "1. one",
    "- item",
    "# head",
    "end",
    "-->|x|",
    "%%{init: {}}%%",
    "%% comment",
    "style:#",
    "$$x$$",
    "fa:fa-car",
    "{{x}}[y](z)",
    "@{shape: cyl}",
    "møbel 机器人 😀",
    "/slash/and_under-score.dot",
    "\u202ertl",
]


def grown(*rows: tuple[str, str, int, str], static: bool = False) -> list[FrameInfo]:
    """The frames of a tree after sets of (parent, child, stamp, authority)."""
    return infos(grow(TransformTree(), *rows, static=static))


def grow(
    tree: TransformTree, *rows: tuple[str, str, int, str], static: bool = False
) -> TransformTree:
    for parent, child, stamp_ns, authority in rows:
        stamped = StampedTransform(parent, child, stamp_ns, Transform())
        tree.set_transform(stamped, authority, static=static)
    return tree


def infos(tree: TransformTree) -> list[FrameInfo]:
    return [tree.frame(name) for name in tree.frames()]


@pytest.fixture
def robot() -> list[FrameInfo]:
    """A link that is late, one of two authorities, one that got a late sample, a static one."""
    tree = TransformTree(cache_time_s=10.0)
    grow(tree, *[("map", "base", NOW_NS - i * S // 10, "wheels") for i in range(20, 0, -1)])
    grow(tree, *[("base", "arm", NOW_NS - i * S, "arm") for i in (9, 8, 7)])
    grow(tree, ("arm", "hand", NOW_NS, "arm"), ("arm", "hand", NOW_NS, "hand"))
    grow(tree, ("arm", "hand", NOW_NS - 60 * S, "arm"))
    grow(tree, ("base", "camera", 0, "mounts"), static=True)
    return infos(tree)


def test_text(robot: list[FrameInfo]) -> None:
    assert export.text(robot, NOW_NS) == TEXT


TEXT = """\
               rate [Hz]  delay [s]      newest [s]  buffer [s]  samples  authority  counted
map
└─ base             10.5      0.100  1699999999.900       1.900       20  wheels
   ├─ arm            1.5      7.000  1699999993.000       2.000        3  arm
   │  └─ hand                 0.000  1700000000.000       0.000        1  hand       COUNTED
   └─ camera      static                                               1  mounts""".replace(
    "COUNTED", "rewritten 1, dropped 1, conflicts 1"
)

#: The labels of the robot's links in a graph.
LINKS = {
    ("map", "base"): [
        "wheels",
        "rate 10.5 Hz",
        "delay 0.100 s",
        "newest 1699999999.900 s",
        "buffer 1.900 s",
        "samples 20",
    ],
    ("base", "arm"): [
        "arm",
        "rate 1.5 Hz",
        "delay 7.000 s",
        "newest 1699999993.000 s",
        "buffer 2.000 s",
        "samples 3",
    ],
    ("arm", "hand"): [
        "hand",
        "delay 0.000 s",
        "newest 1700000000.000 s",
        "buffer 0.000 s",
        "samples 1",
        "rewritten 1",
        "dropped 1",
        "conflicts 1",
    ],
    ("base", "camera"): ["mounts", "static"],
}


def test_dot(robot: list[FrameInfo]) -> None:
    assert links_of_dot(export.dot(robot, NOW_NS)) == LINKS


def test_mermaid(robot: list[FrameInfo]) -> None:
    assert links_of_mermaid(export.mermaid(robot, NOW_NS)) == LINKS


Links = dict[tuple[str, str], list[str]]


def links_of_dot(graph: str) -> Links:
    """Lines of the edges' labels, by the labels of the edges' ends."""

    def lines(label: str) -> list[str]:
        # A line ends at a backslash and n, unless the backslash is itself escaped.
        broken = re.sub(r"\\(.)", lambda pair: {"n": "\0"}.get(pair[1], pair[1]), label)
        return [html.unescape(line) for line in broken.split("\0")]

    quoted = r'"(?P<label>(?:[^"\\]|\\.)*)"'
    head, *statements, last = graph.splitlines()
    assert (head, last) == ("digraph frames {", "}")
    assert [line.split()[0] for line in statements[:2]] == ["node", "edge"]
    node = rf"    (?P<node>n\d+) \[label={quoted}\];"
    edge = rf"    (?P<parent>n\d+) -> (?P<child>n\d+) \[label={quoted}(, style=dashed)?\];"
    return links_of(statements[2:], node, edge, lines)


def links_of_mermaid(chart: str) -> Links:
    """The same. Mermaid's entities are numbers between ``#`` and ``;``."""

    def lines(label: str) -> list[str]:
        broken = label.split("<br/>")
        assert all(re.fullmatch(r"(\w|#\d+;|[ ./-])*", line) for line in broken), label
        return [re.sub(r"#(\d+);", lambda code: chr(int(code[1])), line) for line in broken]

    head, *statements = chart.splitlines()
    assert head == "flowchart TD"
    node = r'    (?P<node>n\d+)\("(?P<label>[^"]*)"\)'
    edge = r'    (?P<parent>n\d+) (-->|-\.->)\|"(?P<label>[^"]*)"\| (?P<child>n\d+)'
    return links_of(statements, node, edge, lines)


def links_of(
    statements: list[str], node: str, edge: str, lines: Callable[[str], list[str]]
) -> Links:
    """Every statement is a node or, after all nodes, an edge."""
    nodes = {m["node"]: lines(m["label"])[0] for s in statements if (m := re.fullmatch(node, s))}
    edges = [re.fullmatch(edge, statement) for statement in statements[len(nodes) :]]
    assert all(edges), statements
    return {(nodes[m["parent"]], nodes[m["child"]]): lines(m["label"]) for m in edges if m}


def test_untrusted_names() -> None:
    frames = grown(*[("map", name, NOW_NS, f"by {name}") for name in HOSTILE])
    expected = {("map", export.printable(name)) for name in HOSTILE}
    for links in (
        links_of_dot(export.dot(frames, NOW_NS)),
        links_of_mermaid(export.mermaid(frames, NOW_NS)),
    ):
        # The tree strips a leading slash, which is tf2's old spelling.
        assert {("map", name.lstrip("/")) for _, name in expected} == links.keys()
        assert all(lines[0].startswith("by ") and len(lines) == 5 for lines in links.values())
        for (_, name), (authority, *_rest) in links.items():
            assert authority.removeprefix("by ").lstrip("/") == name
    lines = export.text(frames, NOW_NS).splitlines()
    assert len(lines) == 2 + len(HOSTILE)
    assert all(line.isprintable() for line in lines)


@pytest.mark.skipif(shutil.which("dot") is None, reason="Graphviz is not installed")
def test_graphviz_shows_the_names() -> None:
    frames = grown(*[("map", name, NOW_NS, f"by {name}") for name in HOSTILE])
    done = subprocess.run(
        ["dot", "-Tsvg"],
        input=export.dot(frames, NOW_NS),
        capture_output=True,
        text=True,
        timeout=150,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    texts = ElementTree.fromstring(done.stdout).iter("{http://www.w3.org/2000/svg}text")
    shown = {(text.text or "").replace("\N{NO-BREAK SPACE}", " ") for text in texts}
    assert {export.printable(f"by {name}") for name in HOSTILE} <= shown


def test_columns_are_aligned_in_every_script() -> None:
    frames = grown(*[("map", name, NOW_NS, "me") for name in ("arm", "机器人", "e\u0301toile")])
    _, _, arm, toile, robot = export.text(frames, NOW_NS).splitlines()
    # Wide characters, and combining ones.
    assert robot.index("1700000000") == arm.index("1700000000") - 3
    assert toile.index("1700000000") == arm.index("1700000000") + 1


@pytest.mark.parametrize(
    ("stamp_ns", "delay"),
    [
        (NOW_NS + S // 2, "delay -0.500 s"),
        (NOW_NS - 24 * 3600 * S, "delay 86400.000 s"),
        (NOW_NS - 24 * 3601 * S, None),
        (NOW_NS + 24 * 3601 * S, None),
        (5 * S, None),
    ],
)
def test_no_delay_against_another_clock(stamp_ns: int, delay: str | None) -> None:
    frames = grown(("map", "base", stamp_ns, "me"))
    for links in (
        links_of_dot(export.dot(frames, NOW_NS)),
        links_of_mermaid(export.mermaid(frames, NOW_NS)),
    ):
        (lines,) = links.values()
        assert [line for line in lines if line.startswith("delay")] == ([delay] if delay else [])
        assert f"newest {stamp_ns // 10**6 / 1000:.3f} s" in lines
    figures = export.text(frames, NOW_NS).splitlines()[-1].split()
    assert (delay is not None and delay.split()[1] in figures) == (delay is not None)
    assert len(figures) == (7 if delay else 6)


def test_now_is_this_machines_clock() -> None:
    frames = grown(("map", "base", time.time_ns() - 100 * S, "me"))
    ((_authority, delay, *_rest),) = links_of_dot(export.dot(frames)).values()
    assert 100 <= float(delay.split()[1]) < 160


def test_an_empty_tree() -> None:
    assert export.text([]) == "no frames"
    assert '"no frames"' in export.dot([])
    assert '"no frames"' in export.mermaid([])


def test_a_parent_that_is_not_in_the_list() -> None:
    frames = [info for info in grown(("map", "base", NOW_NS, "me")) if info.name == "base"]
    assert export.text(frames, NOW_NS).splitlines()[1].startswith("base ")
    assert [*links_of_dot(export.dot(frames, NOW_NS))] == [("map", "base")]
    assert [*links_of_mermaid(export.mermaid(frames, NOW_NS))] == [("map", "base")]


def test_a_list_gathered_while_parents_changed() -> None:
    """base below arm at one moment, arm below base at another: every frame is there once."""
    (base,) = [f for f in grown(("arm", "base", NOW_NS, "me")) if f.name == "base"]
    (arm,) = [f for f in grown(("base", "arm", NOW_NS, "me")) if f.name == "arm"]
    lines = export.text([base, arm], NOW_NS).splitlines()
    assert [line.split("  ")[0] for line in lines[1:]] == ["arm", "└─ base"]
    assert links_of_dot(export.dot([base, arm])).keys() == {("arm", "base"), ("base", "arm")}


def test_a_chain_of_a_thousand_links() -> None:
    frames = grown(*[(str(i), str(i + 1), NOW_NS, "me") for i in range(1000)])
    assert len(export.text(frames, NOW_NS).splitlines()) == 1002
    assert export.dot(frames, NOW_NS).count(" -> ") == 1000
    assert export.mermaid(frames, NOW_NS).count(" -->|") == 1000


def test_painted_parts_make_up_the_text(robot: list[FrameInfo]) -> None:
    painted = export.text(robot, NOW_NS, paint=lambda part, text: f"<{part}>{text}</>")
    assert re.sub(r"</?\w*>", "", painted) == export.text(robot, NOW_NS)
    (arm,) = [line for line in painted.splitlines() if "<frame>arm</>" in line]
    assert "<late>" in arm
    assert painted.count("<static>") == 1
    assert "  rewritten 1, dropped 1, conflicts 1</>" in painted
