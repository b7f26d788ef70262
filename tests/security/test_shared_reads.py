"""With access rules, the server names the tree's memory only to clients that may read."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.c_api.test_server_writes import LONG_MS, writer_of
from tests.conftest import StartServer
from zenoh_tf.errors import AccessDenied

from .conftest import Files, connect, tls_endpoint

RULES = """
[[access]]
users = ["reader"]
may = ["read"]

[[access]]
users = ["wheels"]
publish = ["wheels", "writer"]
"""


@pytest.mark.skipif(sys.platform != "linux", reason="needs memfd")
def test_the_offer_follows_the_rules(
    start_sharing: StartServer, files: Files, tmp_path: Path
) -> None:
    config = tmp_path / "server.toml"
    config.write_text(RULES)
    flags = ["--config", str(config), "--users", files.users, *files.server_flags()]
    server = start_sharing(*flags, endpoint=tls_endpoint())
    with connect(server, files.user("reader"), reads="shared") as tf:
        assert tf.reads == "shared"
        assert not tf.can_transform("map", "base")
    with connect(server, files.user("wheels"), reads="shared") as tf:
        assert tf.reads == "query"
        with pytest.raises(AccessDenied, match="may not read"):
            tf.can_transform("map", "base")


@pytest.mark.skipif(sys.platform != "linux", reason="needs memfd")
def test_a_c_program_may_write_what_its_session_may(
    start_sharing: StartServer, files: Files, tmp_path: Path, socket_folder: Path
) -> None:
    config = tmp_path / "server.toml"
    config.write_text(RULES)
    flags = ["--config", str(config), "--users", files.users, *files.server_flags()]
    server = start_sharing(*flags, endpoint=tls_endpoint())
    links = ("map", "a", "a", "b", 1, 0, 0)
    with writer_of(server, socket_folder, LONG_MS, files.user("wheels")) as writer:
        writer.do("set_xact", *links)  # as "writer"
    with writer_of(server, socket_folder, 500, files.user("reader")) as writer:
        # Zenoh itself drops the query, so nobody can say more.
        assert writer.ask("set_xact", *links)[0] in ("ZTF_OUTCOME_UNKNOWN", "ZTF_ACCESS_DENIED")
