"""The programs of README.md run as they stand there."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import StartServer
from tests.support.waiting import wait_until

README = Path(__file__).resolve().parents[2] / "README.md"
FIRST, SENSOR, LOOKUP = re.findall(r"```python\n(.*?)```", README.read_text(), re.S)


@pytest.mark.parametrize("tree", ["main", "shop/floor"])
def test_a_sensor_and_a_lookup_of_the_present(start_server: StartServer, tree: str) -> None:
    server = start_server(tree=tree)
    where = os.environ | {"ZENOH_TF_CONNECT": server.endpoint, "ZENOH_TF_TREE": tree}
    with subprocess.Popen([sys.executable, "-c", SENSOR], env=where) as sensor:
        try:
            with server.connect() as tf:
                wait_until(lambda: tf.can_transform("map", "camera"))
                assert [each.name for each in tf.authorities()] == ["wheels"]
            done = subprocess.run(  # noqa: PLW1510
                [sys.executable, "-c", LOOKUP],
                env=where,
                capture_output=True,
                text=True,
                timeout=60,
            )
        finally:
            sensor.kill()
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("StampedTransform('map', 'camera', stamp_ns=")
