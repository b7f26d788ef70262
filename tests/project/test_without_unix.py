"""The tree and the client, without what Python has on Unix only. They were never run on Windows."""

from __future__ import annotations

import subprocess
import sys

from tests.processes.servers import ServerProcess

# What Windows lacks, as far as a running Python can do without.
_HIDE = """
import ctypes, os, socket, sys, time
for name in ("fcntl", "grp", "pwd", "resource", "termios", "uvloop"):
    sys.modules[name] = None
del os.fork, os.register_at_fork, os.geteuid, os.getuid, socket.AF_UNIX, time.clock_gettime_ns
load = ctypes.CDLL.__init__
def of_a_file(self, name, *arguments, **options):
    if name is None:
        raise TypeError("bad argument type for built-in operation")
    load(self, name, *arguments, **options)
ctypes.CDLL.__init__ = of_a_file
"""
_TREE = """
import zenoh_tf
tree = zenoh_tf.TransformTree()
link = zenoh_tf.StampedTransform("map", "base", 5, zenoh_tf.Transform(translation=(1.0, 0.0, 0.0)))
tree.set_transform(link)
assert tree.lookup_transform("map", "base", 5).transform.translation[0] == 1.0
"""
_CLIENT = """
import zenoh_tf_client
with zenoh_tf_client.TransformClient.connect(sys.argv[1], sys.argv[2], reads="query") as tf:
    tf.set_transform(link)
    assert tf.lookup_transform("map", "base", 5).transform.translation[0] == 1.0
    with tf.mirror() as copy:
        copy.wait_for()
        assert copy.lookup_transform("map", "base", 5).transform.translation[0] == 1.0
"""
_LAZY = """
import sys, zenoh_tf_client
slow = {"asyncio", "email", "ssl", "uvloop", "zenoh_tf_server", "zenoh_tf_tools"}
later = {"hashlib", "html", "pathlib", "zenoh_tf.gates", "zenoh_tf.introspection"}
later |= {"zenoh_tf_client.mirror"} | slow
assert not later & set(sys.modules), later & set(sys.modules)
zenoh_tf_client.AsyncTransformClient, zenoh_tf_client.__version__
assert slow & set(sys.modules) == {"asyncio", "email", "ssl"}, slow & set(sys.modules)
"""


def _run(program: str, *arguments: str) -> None:
    subprocess.run([sys.executable, "-c", program, *arguments], check=True, timeout=60.0)


def test_the_tree_needs_nothing_of_unix() -> None:
    _run(_HIDE + _TREE)


def test_the_client_needs_nothing_of_unix(server: ServerProcess) -> None:
    _run(_HIDE + _TREE + _CLIENT, server.endpoint, server.tree)


def test_the_client_imports_little() -> None:
    _run(_LAZY)
