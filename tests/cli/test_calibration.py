"""``zenoh-tf calibration``, with every line of docs/how-to/calibration.md."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from tests.processes.servers import ServerProcess
from tests.support.command_line import Run
from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import TransformClient
from zenoh_tf_tools.cli.setup import calibration

from .conftest import document, refusal, succeeds

PAGE = (Path(__file__).parents[2] / "docs/how-to/calibration.md").read_text()


@pytest.fixture
def run(
    server: ServerProcess, zenoh_tf: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Run:
    """``run(*args)``: one command on the server, in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ZENOH_TF_CONNECT", server.endpoint)
    return zenoh_tf


def link(parent: str, child: str, pose: Transform | None = None) -> StampedTransform:
    return StampedTransform(parent, child, 0, pose or Transform())


def blocks(kind: str) -> list[str]:
    found = re.findall(r"^```(\w*)\n(.*?)^```$", PAGE, re.M | re.S)
    return [block for language, block in found if language == kind]


def test_every_documented_line(run: Run, tmp_path: Path) -> None:
    printed: dict[str, list[str]] = {}
    for line in "".join(blocks("sh")).splitlines():
        command, *arguments = shlex.split(line)
        assert command == "zenoh-tf"
        printed.setdefault(line, []).append(succeeds(run(*arguments)))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["camera.toml", "cell.toml"]
    assert printed["zenoh-tf calibration save cell.toml"] == ["2 links saved to cell.toml\n"]
    first, last = printed["zenoh-tf calibration diff cell.toml"]
    assert [first] == blocks("")
    assert last == "from cell.toml to tree 'main'\n2 links are the same\n"
    assert blocks("toml")[0] in (tmp_path / "cell.toml").read_text()
    assert "nothing was set" in printed["zenoh-tf calibration load cell.toml --dry-run"][0]


def test_the_examples_of_the_help_are_commands(run: Run, client: TransformClient) -> None:
    client.set_transform(link("base", "camera"), static=True)
    for action in ((), ("save",), ("load",), ("diff",)):
        examples = succeeds(run("calibration", *action, "--help")).split("examples:")[1]
        lines = [shlex.split(line, comments=True)[1:] for line in examples.strip().splitlines()]
        assert len(lines) == 4
    for line in lines:
        succeeds(run(*line))


def test_names_and_poses_come_back_exactly(run: Run, client: TransformClient) -> None:
    tf = client
    names = ['"', "\\", "a\nb", "\x7f\x1b[31m", "karte \U0001f916", "#]", "'''"]
    pose = Transform((0.1, -1e-17, 1e149), (0.1, 0.2, 0.3, (1 - 0.14) ** 0.5))
    tf.set_transforms_xact([link("base", name, pose) for name in names], static=True)
    tf.set_transform(link("base", "dynamic"))
    before = [tf.lookup_transform("base", name) for name in names]
    assert document(run("calibration", "save", "odd", "--json"))["links"] == len(names)
    tf.reset()
    tf.set_transform(link("base", "other"), static=True)
    tf.set_transform(link("map", names[0]))
    done = document(run("calibration", "load", "odd", "--json"))
    assert (done["applied"], done["file"]) == (True, "odd")
    assert {each["kind"] for each in done["links"]} == {"added"}
    assert [tf.lookup_transform("base", name) for name in names] == before
    assert tf.frame(names[1]).authority == "calibration"
    assert "other" in tf.frames()
    assert document(run("calibration", "load", "odd", "--json"))["applied"] is False


def test_load_is_one_transaction(run: Run, client: TransformClient) -> None:
    tf = client
    tf.set_transforms_xact([link("a", "b"), link("a", "c")], static=True)
    succeeds(run("calibration", "save", "good"))
    tf.reset()
    tf.set_transform(link("b", "a"), static=True)  # the calibration would close a cycle
    assert "cycle" in run("calibration", "load", "good").stderr
    assert sorted(tf.frames()) == ["a", "b"]


def test_every_kind_of_difference(run: Run, client: TransformClient) -> None:
    tf = client
    names = ["moved", "turned", "reparented", "removed", "same"]
    tf.set_transforms_xact([link("base", name) for name in names], static=True)
    succeeds(run("calibration", "save", "cell"))
    tf.set_transforms_xact(
        [
            link("base", "moved", Transform((0.003, 0.004, 0))),
            link("base", "turned", Transform((0, 0, 0), (0, 0, -1, 0))),
            link("moved", "reparented"),
            link("base", "added"),
        ],
        static=True,
    )
    tf.remove_frame("removed")
    found = {
        each["child"]: each
        for each in document(run("calibration", "diff", "cell", "--json"))["links"]
    }
    assert {name: each["kind"] for name, each in found.items()} == {
        "moved": "moved",
        "turned": "moved",
        "reparented": "reparented",
        "removed": "removed",
        "added": "added",
        "same": "same",
    }
    assert found["moved"]["translation_mm"] == pytest.approx(5)
    assert found["moved"]["offset_mm"] == pytest.approx([3, 4, 0])
    assert found["turned"]["rotation_deg"] == pytest.approx(180)
    text = succeeds(run("calibration", "diff", "cell"))
    assert [line[0] for line in text.splitlines()[1:-1]] == ["+", "~", "-", ">", "~"]


def test_small_rotations_are_exact() -> None:
    before = {"c": link("p", "c")}
    after = {"c": link("p", "c", Transform.from_rpy(1e-6, 0, 0))}
    (difference,) = calibration._differences(before, after)
    assert difference["kind"] == "moved"
    assert difference["rotation_deg"] == pytest.approx(5.7295779513e-05, rel=1e-9)


LINK = "[[link]]\nchild = 'c'\nparent = 'p'\ntranslation = [1, 2, 3]\nrotation = [0, 0, 0, 1]\n"
BAD_FILES = {
    "not TOML": ("cell = = 2", "cannot read"),
    "no links": ("", "it has no [[link]]"),
    "a link twice": (LINK + LINK, "'c' is there twice"),
    "no table": ("link = [1]", "child of link 1 is missing"),
    "no parent": ("[[link]]\nchild = 'c'\n", "parent of link 1 is missing"),
    "a short vector": (
        LINK.replace("[1, 2, 3]", "[1, 2]"),
        "translation of link 1 is not 3 finite numbers",
    ),
    "no float": (
        LINK.replace("[1, 2, 3]", f"[1, 1{'0' * 309}, 3]"),
        "translation of link 1 is not 3 finite numbers",
    ),
    "no rotation": (
        LINK + LINK.replace("[0, 0, 0, 1]", "[0, 0, 0, 2]"),
        "rotation of link 2 is not a unit quaternion",
    ),
}


@pytest.mark.parametrize("kind", BAD_FILES)
def test_a_bad_file(zenoh_tf: Run, tmp_path: Path, kind: str) -> None:
    text, reason = BAD_FILES[kind]
    path = tmp_path / "cell.toml"
    path.write_text(text)
    line = refusal(zenoh_tf("calibration", "diff", str(path)))
    assert reason in line
    assert str(path) in line


def test_errors(run: Run, client: TransformClient, tmp_path: Path) -> None:
    assert "tree 'main' has no static links" in refusal(run("calibration", "save", "cell"))
    client.set_transform(link("base", "camera"), static=True)
    missing = refusal(run("calibration", "load", "cell"))
    assert "cannot read cell: No such file or directory" in missing
    missing = refusal(run("calibration", "save", "cell", "--frame", "lidar"))
    assert "frame 'lidar' has no static link in tree 'main'" in missing
    (tmp_path / "file").write_text("")
    unwritable = run("calibration", "save", str(tmp_path / "file" / "cell"))
    assert "cannot write " in refusal(unwritable)
    (tmp_path / "folder").mkdir()
    assert "Is a directory" in refusal(run("calibration", "save", "folder"))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder"]
