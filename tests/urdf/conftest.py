"""What tests of robot descriptions share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.processes.servers import ServerProcess
from zenoh_tf_client import TransformClient


@pytest.fixture
def tf(shared_server: ServerProcess) -> Iterator[TransformClient]:
    with shared_server.connect() as client:
        client.reset()
        yield client
