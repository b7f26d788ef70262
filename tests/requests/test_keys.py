"""Any name can be escaped into a key expression, and be recovered from it."""

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from zenoh_tf._net import keys
from zenoh_tf.errors import InvalidArgumentException

AWKWARD = [
    "", " ", "/", "//", "a/b", "*", "**", "$*", "a$*b", "?", "#", "%", "%%", "%2F", "@", "@/x",
    "a@b", "\0", "\n", "\x7f", "\x85", "\u2028", ".", "..", "-", "ü", "机器人", "🤖", "e\u0301",
]  # fmt: skip


@pytest.mark.parametrize("name", AWKWARD)
def test_awkward_names_survive_a_key(name: str) -> None:
    key = keys.put(name, name, static=False)
    assert keys.last_name(str(zenoh.KeyExpr(key))) == name
    assert str(zenoh.KeyExpr.autocanonize(key)) == key
    assert key.count("/") == 4


@given(st.text(max_size=60))
def test_any_text_survives_a_key(name: str) -> None:
    chunk = keys.escape(name)
    assert keys.unescape(chunk) == name
    key = f"tf/v1/{chunk}/lookup"
    assert str(zenoh.KeyExpr(key)) == key
    assert zenoh.KeyExpr("tf/v1/*/lookup").includes(zenoh.KeyExpr(key))


@pytest.mark.parametrize("chunk", ["", "%2f", "%41", "a%", "%ZZ", "%FF", "*", "**", "a b"])
def test_spellings_that_escape_never_makes_are_refused(chunk: str) -> None:
    with pytest.raises(InvalidArgumentException):
        keys.unescape(chunk)


def test_names_that_no_key_can_hold_are_refused() -> None:
    with pytest.raises(InvalidArgumentException) as lone:
        keys.request("\ud800", "lookup")
    assert lone.value.field == "tree"
    with pytest.raises(InvalidArgumentException) as long:
        keys.put("main", "x" * 256, static=True)
    assert (long.value.field, long.value.limit, long.value.value) == ("authority", 255, 256)
    with pytest.raises(InvalidArgumentException):
        keys.request("main", "drop")


def test_keys_are_as_documented() -> None:
    assert keys.request("main", "lookup") == "tf/v1/main/lookup"
    assert keys.put("main", "lidar/front", static=False) == "tf/v1/main/set/lidar%2Ffront"
    assert keys.put("main", "urdf", static=True) == "tf/v1/main/static/urdf"
    assert keys.server("main", "0af3") == "tf/v1/main/server/0af3"
    assert keys.servers("@") == "tf/v1/%40/server/*"
    assert keys.all_servers() == "tf/v1/*/server/*"
    assert keys.candidate("main", "0af3") == "tf/v1/main/candidate/0af3"
    assert keys.candidates("@") == "tf/v1/%40/candidate/*"


@pytest.mark.parametrize("name", AWKWARD)
def test_any_key_names_its_tree(name: str) -> None:
    key = keys.server(name, "0af3")
    assert keys.tree_name(key) == name
    assert zenoh.KeyExpr(keys.all_servers()).includes(zenoh.KeyExpr(key))
