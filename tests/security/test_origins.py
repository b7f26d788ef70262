"""Only the viewer's own page may open its WebSocket."""

from __future__ import annotations

import pytest
import viser
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from zenoh_tf_tools.viewer.origins import is_own
from zenoh_tf_tools.viewer.viewer import close_server, open_server

HOST = "127.0.0.1"


@pytest.mark.parametrize(
    ("origin", "host"),
    [
        (None, "127.0.0.1:8080"),
        ("http://127.0.0.1:8080", "127.0.0.1:8080"),
        ("http://localhost:9000", "localhost:9000"),
        ("http://[::1]:8080", "[::1]:8080"),
        ("https://robot.local", "robot.local"),
    ],
)
def test_pages_of_the_viewer(origin: str | None, host: str) -> None:
    assert is_own(origin, host)


@pytest.mark.parametrize(
    ("origin", "host"),
    [
        ("http://evil.example", "127.0.0.1:8080"),
        ("null", "127.0.0.1:8080"),
        ("http://evil.example:8080", "evil.example:8080"),  # a name that points here for a moment
        ("http://127.0.0.1:8081", "127.0.0.1:8080"),
        ("file://", None),
        ("http://[", "["),
    ],
)
def test_pages_of_others(origin: str, host: str | None) -> None:
    assert not is_own(origin, host)


def test_the_server_asks_for_the_origin() -> None:
    server = open_server(HOST, 0)
    try:
        where = f"{HOST}:{server.get_port()}"
        protocols = [f"viser-v{viser.__version__}"]
        with connect(f"ws://{where}", origin=f"http://{where}", subprotocols=protocols) as own:  # type: ignore[arg-type]
            assert own.recv(timeout=20)
        for origin in ("http://evil.example", "null"):
            with pytest.raises(InvalidStatus) as caught:
                connect(f"ws://{where}", origin=origin, subprotocols=protocols).close()  # type: ignore[arg-type]
            assert caught.value.response.status_code == 403
    finally:
        close_server(server)
