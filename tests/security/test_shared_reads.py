"""With access rules, the server names the tree's memory only to clients that may read."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.conftest import StartServer
from zenoh_tf.errors import AccessDenied

from .conftest import Files, connect, tls_endpoint

RULES = """
[[access]]
users = ["reader"]
may = ["read"]

[[access]]
users = ["wheels"]
publish = ["wheels"]
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
