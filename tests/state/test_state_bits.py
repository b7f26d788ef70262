"""The file of the state: no bit that has changed is read as something else, and who may read it."""

from __future__ import annotations

import random
import shutil
import stat
from pathlib import Path

import pytest

from zenoh_tf_server.state.file import StateError, StateFile, Stored, StoredLink, Table

#: Removals are small, and so are their pages: each bit of them is tried.
REMOVED = {f"gone{number}": number + 1 for number in range(5)}


def link(x: float, *, by_call: bool = False) -> StoredLink:
    return StoredLink("map", 7, (x, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0), "calibration", by_call)


def stored(folder: Path) -> tuple[bytes, Stored]:
    """The bytes of a state, and what it holds."""
    file = StateFile(folder, "main")
    links: dict[tuple[Table, str], StoredLink | int | None] = {
        (Table.STATIC_LINKS, f"child{n}"): link(n, by_call=n % 2 == 0) for n in range(12)
    }
    removed = {(Table.REMOVED_LINKS, name): number for name, number in REMOVED.items()}
    file.write({**links, **removed})
    found = file.read()
    file.close()
    assert found.removed_links == REMOVED
    return file.path.read_bytes(), found


def check_flips(folder: Path, bits: list[int]) -> None:
    """Each of these bits, if it is another one, is an error or makes no difference."""
    data, expected = stored(folder / "whole")
    refused = 0
    for bit in bits:
        damaged = bytearray(data)
        damaged[bit // 8] ^= 1 << bit % 8
        copy = folder / "copy"
        copy.mkdir()
        (copy / "state.sqlite3").write_bytes(damaged)
        try:
            file = StateFile(copy, "main")
            try:
                assert file.read() == expected, f"bit {bit % 8} of byte {bit // 8}"
            finally:
                file.close()
        except StateError:
            refused += 1
        shutil.rmtree(copy)
    assert refused > 0


def bits_of(data: bytes, text: bytes, size: int) -> list[int]:
    """All bits of `size` bytes from each place where a text is."""
    found: list[int] = []
    at = data.find(text)
    while at >= 0:
        found += range(8 * at, 8 * (at + size))
        at = data.find(text, at + 1)
    return found


def test_a_flipped_bit_of_a_removal_is_noticed(tmp_path: Path) -> None:
    data, _ = stored(tmp_path / "first")
    check_flips(
        tmp_path, bits_of(data, b"gone3", 7)
    )  # the name, in table and index, and its number


def test_a_flipped_bit_of_the_trees_name_is_noticed(tmp_path: Path) -> None:
    data, _ = stored(tmp_path / "first")
    check_flips(tmp_path, bits_of(data, b"main", 4))


def test_flipped_bits_are_noticed(tmp_path: Path) -> None:
    data, _ = stored(tmp_path / "first")
    check_flips(tmp_path, random.Random(7).sample(range(8 * len(data)), 200))


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_each_flipped_bit_is_noticed(tmp_path: Path) -> None:
    data, _ = stored(tmp_path / "first")
    check_flips(tmp_path, [bit for bit in range(8 * len(data)) if data[bit // 8]])


def test_only_the_owner_may_read_the_file(tmp_path: Path) -> None:
    folder = tmp_path / "state"
    folder.mkdir(mode=0o755)
    file = StateFile(folder, "main")
    file.write({(Table.STATIC_LINKS, "child"): link(1)})
    modes = {path.name: stat.S_IMODE(path.stat().st_mode) for path in folder.iterdir()}
    file.close()
    assert set(modes.values()) == {0o600}
    assert modes.keys() >= {"state.sqlite3", "lock"}
