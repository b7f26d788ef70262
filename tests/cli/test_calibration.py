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
from zenoh_tf_tools.cli.setup import calibration_diff, calibration_files

from .conftest import document, refusal, succeeds

PAGE = (Path(__file__).parents[2] / "docs/how-to/calibration.md").read_text()


@pytest.fixture
def run(
    server: ServerProcess, zenoh_tf: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Run:
    """``run(*args)``: one command on the server, with a data folder of its own."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    monkeypatch.setenv("ZENOH_TF_CONNECT", server.endpoint)
    return zenoh_tf


def link(parent: str, child: str, pose: Transform | None = None) -> StampedTransform:
    return StampedTransform(parent, child, 0, pose or Transform())


def blocks(kind: str) -> list[str]:
    found = re.findall(r"^```(\w*)\n(.*?)^```$", PAGE, re.M | re.S)
    return [block for language, block in found if language == kind]


def test_every_documented_line(run: Run, tmp_path: Path) -> None:
    printed: dict[str, str] = {}
    for line in "".join(blocks("sh")).splitlines():
        command, *arguments = shlex.split(line)
        assert command == "zenoh-tf"
        printed[line] = succeeds(run(*arguments))
    folder = tmp_path / "zenoh-tf" / "calibrations"
    assert sorted(path.name for path in folder.iterdir()) == [
        "camera-only@1.toml",
        "cell@1.toml",
        "cell@2.toml",
    ]
    (documented,) = blocks("")
    assert printed["zenoh-tf calibration diff cell@1 cell@2"] == documented
    assert printed["zenoh-tf calibration list"].count("\n") == 2
    (example,) = blocks("toml")
    written = (folder / "cell@1.toml").read_text()
    assert example.split("[[link]]")[1] in written
    last = printed["zenoh-tf calibration diff cell@1"]
    assert last == "from cell@1 to tree 'main'\n2 links are the same\n"
    assert "nothing was set" in printed["zenoh-tf calibration load cell@1 --dry-run"]


def test_the_examples_of_the_help_are_commands(run: Run, client: TransformClient) -> None:
    client.set_transform(link("base", "camera"), static=True)
    for action in ((), ("save",), ("load",), ("diff",), ("list",)):
        examples = succeeds(run("calibration", *action, "--help")).split("examples:")[1]
        lines = [shlex.split(line, comments=True)[1:] for line in examples.strip().splitlines()]
        assert len(lines) == 6
    succeeds(run(*lines[0]))
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
    assert (done["applied"], done["calibration"]) == (True, "odd@1")
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
    (difference,) = calibration_diff.compare(before, after)
    assert difference.kind == "moved"
    assert difference.rotation_deg == pytest.approx(5.7295779513e-05, rel=1e-9)


BAD_FILES = {
    "not TOML": ("cell = = 2", "cannot read"),
    "another format": ("format = 2", "format is 2, and this zenoh-tf knows 1"),
    "a link twice": ("{0}{1}{1}", "'c' is there twice"),
    "no parent": ("{0}[[link]]\nchild = 'c'\n", "parent of link 1 is missing"),
    "a short vector": (
        "{0}[[link]]\nchild = 'c'\nparent = 'p'\ntranslation = [1, 2]\nrotation = [0, 0, 0, 1]\n",
        "translation of link 1 is not 3 finite numbers",
    ),
    "no rotation": (
        "{0}" + "[[link]]\nchild = 'c'\nparent = 'p'\n"
        "translation = [1, 2, 3]\nrotation = [0, 0, 0, 2]\n",
        "rotation of link 1 is not a unit quaternion",
    ),
}
HEAD = 'format = 1\nsaved = ""\ntree = ""\nnote = ""\n'
LINK = "[[link]]\nchild = 'c'\nparent = 'p'\ntranslation = [1, 2, 3]\nrotation = [0, 0, 0, 1]\n"


@pytest.mark.parametrize("kind", BAD_FILES)
def test_a_bad_file(zenoh_tf: Run, tmp_path: Path, kind: str) -> None:
    text, reason = BAD_FILES[kind]
    path = tmp_path / "cell@1.toml"
    path.write_text(text.format(HEAD, LINK))
    line = refusal(zenoh_tf("calibration", "diff", "cell", "cell", "--dir", str(tmp_path)))
    assert reason in line
    assert str(path) in line


def test_errors(run: Run, client: TransformClient, tmp_path: Path) -> None:
    assert "tree 'main' has no static links" in refusal(run("calibration", "save", "cell"))
    client.set_transform(link("base", "camera"), static=True)
    assert "no calibration cell in " in refusal(run("calibration", "load", "cell"))
    succeeds(run("calibration", "save", "cell"))
    assert "; there is cell" in refusal(run("calibration", "load", "cells"))
    assert "no cell@7 in " in refusal(run("calibration", "load", "cell@7"))
    missing = run("calibration", "save", "cell", "--frame", "lidar")
    assert "frame 'lidar' has no static link in tree 'main'" in refusal(missing)
    for name in ("../cell", "live", "a@1", ""):
        done = run("calibration", "save", name)
        assert done.returncode == 2
        assert "is not a name" in done.stderr
    assert run("calibration", "load", "cell@0").returncode == 2
    (tmp_path / "file").write_text("")
    unwritable = run("calibration", "save", "cell", "--dir", str(tmp_path / "file"))
    assert "cannot write to " in refusal(unwritable)


def test_saves_at_the_same_time_get_different_versions(tmp_path: Path) -> None:
    folders = [calibration_files.Folder(tmp_path) for _ in range(2)]
    links = {"c": link("p", "c")}
    original = calibration_files.Folder.references
    saved = [each.save("cell", links, "main", "") for each in folders]
    assert [each.reference.version for each in saved] == [1, 2]
    # The second looks before the first has written.
    stale = original(folders[0], "cell")
    saved.append(folders[0].save("cell", links, "main", ""))
    answers = iter([stale])
    folders[1].references = lambda name=None: next(answers, original(folders[1], name))  # type: ignore[method-assign]
    saved.append(folders[1].save("cell", links, "main", ""))
    assert [each.reference.version for each in saved] == [1, 2, 3, 4]
