"""A page of viser, and a viewer that draws there."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import pytest

from tests.processes.ports import free_port

if TYPE_CHECKING:
    from tests.viewer.viewers import Tree
    from zenoh_tf_tools.viewer.viewer import Viewer


@pytest.fixture(scope="module")
def viser_server() -> Iterator[Any]:
    from zenoh_tf_tools.viewer.viewer import close_server, open_server  # noqa: PLC0415 - an extra

    server = open_server("127.0.0.1", free_port())
    yield server
    close_server(server)


@pytest.fixture
def tree() -> Tree:
    from tests.viewer.viewers import Tree  # noqa: PLC0415 - it imports the extra

    return Tree()


@pytest.fixture
def viewer(viser_server: Any, tree: Tree) -> Iterator[Viewer]:
    from tests.viewer.viewers import opened  # noqa: PLC0415 - it imports the extra

    with opened(viser_server, tree) as viewer:
        yield viewer
