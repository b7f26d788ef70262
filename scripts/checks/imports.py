"""What the packages import from outside: run-time dependencies, and extras in one package each."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator

from .repository import Repository, Violation

PACKAGES = {
    "zenoh_tf": "zenoh_tf",
    "zenoh_tf_server": "server/zenoh_tf_server",
    "zenoh_tf_client": "client/zenoh_tf_client",
    "zenoh_tf_tools": "client/zenoh_tf_tools",
}
RUN_TIME = {"zenoh", "numpy", "msgpack", "uvloop"}
#: Optional imports: what an extra brings, and the one package that may use it.
EXTRAS = {
    "foxglove": "zenoh_tf_tools",
    "rerun": "zenoh_tf_tools",
    "matplotlib": "zenoh_tf_tools",
    "prometheus_client": "zenoh_tf_server",
    "geometry_msgs": "zenoh_tf",  # of ROS 2, as rclpy and tf2_msgs
    "lz4": "zenoh_tf",
    "mcap": "zenoh_tf",
    "rclpy": "zenoh_tf",
    "rosbags": "zenoh_tf",
    "pandas": "zenoh_tf",
    "pyarrow": "zenoh_tf",
    "scipy": "zenoh_tf",
    "shtab": "zenoh_tf_tools",
    "tf2_msgs": "zenoh_tf",
    "tomli": "zenoh_tf",  # for Python 3.10
    "trimesh": "zenoh_tf_tools",  # viser brings it
    "viser": "zenoh_tf_tools",
    "websockets": "zenoh_tf_tools",  # viser brings it
    "xxhash": "zenoh_tf",
    "zstandard": "zenoh_tf",
}


def imports(repository: Repository) -> Iterator[Violation]:
    """Only run-time dependencies are imported, and extras, which have one place each."""
    for package, folder in PACKAGES.items():
        for path in repository.files(".py", under=[folder]):
            for line, name in _imported(repository.text(path)):
                known = name in PACKAGES or name in sys.stdlib_module_names or name in RUN_TIME
                if not known and EXTRAS.get(name) != package:
                    problem = f"imports {name}, which is no run-time dependency; see EXTRAS"
                    yield Violation(path, line, problem)
        if not repository.exists(f"{folder}/py.typed"):
            yield Violation(f"{folder}/py.typed", 1, "is missing, so the package is not typed")


def _imported(text: str) -> Iterator[tuple[int, str]]:
    """Every top-level module that a file imports absolutely at run time, with its line."""
    tree = ast.parse(text)
    for node in list(ast.walk(tree)):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            node.body.clear()
    for node in ast.walk(tree):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            names = [node.module]
        for name in names:
            yield node.lineno, name.split(".")[0]  # type: ignore[attr-defined]
