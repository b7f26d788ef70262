"""Programs that end without closing anything end with status 0 and print nothing."""

from __future__ import annotations

import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest

from tests.conftest import StartServer
from tests.processes.servers import ServerProcess

pytestmark = pytest.mark.slow

#: Zenoh looks for signals ten times a second in every thread that waits, so a script has to run
#: for longer than that. Under load the interpreter takes longer to end, which widens the race.
RUNS = 8
TOGETHER = 4

DAEMONS_THAT_WAIT = """
import threading, time
from zenoh_tf import StampedTransform, Transform, TransformException, TransformTree

tree = TransformTree()
tree.set_transform(StampedTransform("a", "b", 1, Transform()))
waiting = threading.Barrier(5)

def wait(timeout_s):
    waiting.wait()
    while True:
        try:
            tree.lookup_transform("a", "b", 5, timeout_s=timeout_s)
        except TransformException:
            pass

for timeout_s in (0.001, 0.01, 0.05, 100):
    threading.Thread(target=wait, args=(timeout_s,), daemon=True).start()
waiting.wait()
time.sleep(0.05)
"""

CONNECT = """
import sys, threading, time
from zenoh_tf import StampedTransform, Transform, TransformException
from zenoh_tf_client import TransformClient

tf = TransformClient.connect(sys.argv[1])
link = StampedTransform("a", "b", 0, Transform())

def forever(action):
    def loop():
        while True:
            action()
    threading.Thread(target=loop, daemon=True).start()
"""

#: What a script leaves unclosed, and how it keeps running until it ends.
NEVER_CLOSED = {
    "client": "tf.set_transform(link)",
    "broadcaster": 'sensor = tf.broadcaster("sensor"); sensor.send(link)',
    "broadcaster with statics": """
for number in range(20):  # each has a thread of its own that waits for new servers
    tf.broadcaster(f"sensor {number}").send_static(link)
assert tf.can_transform("a", "b", timeout_s=10)
""",
    "daemon thread in a lookup": """
for _ in range(20):
    forever(lambda: tf.lookup_transform("a", "never", timeout_s=100))
""",
    "daemon threads that read": """
tf.set_transform(link)
for _ in range(4):
    forever(lambda: tf.lookup_latest_transform("a", "b"))
""",
    "daemon thread that publishes": """
sensor = tf.broadcaster("sensor")
forever(lambda: (sensor.send(link), time.sleep(0)))
""",
    "daemon threads that connect": """
def connect():
    try:
        TransformClient.connect("tcp/127.0.0.1:9", timeout_s=0.05)
    except TransformException:
        pass

for _ in range(4):
    forever(connect)
""",
    "mirrors": """
mirrors = [tf.mirror() for _ in range(4)]
forever(lambda: tf.set_transform(link))  # so that there is something to apply
""",
    "tf2 shim": """
from zenoh_tf_client import tf2
tf2.connect(sys.argv[1])
message = tf2.TransformStamped()
message.header.frame_id, message.child_frame_id = "a", "b"
tf2.StaticTransformBroadcaster().sendTransform(message)
waits = [tf2.Buffer().wait_for_transform_async("a", "never", tf2.Time()) for _ in range(10)]
""",
}


#: How a program's event loop ends, with calls under way.
LOOP_ENDS = {
    "cancelled tasks": "asyncio.run(main())",
    "uvloop": "uvloop.run(main())",
    "closed at once": """
loop = asyncio.new_event_loop()
loop.run_until_complete(main())
for task in asyncio.all_tasks(loop):
    task._log_destroy_pending = False  # the script's own tasks, which never end
loop.close()
""",
    "uvloop closed at once": """
loop = uvloop.new_event_loop()
loop.run_until_complete(main())
for task in asyncio.all_tasks(loop):
    task._log_destroy_pending = False
loop.close()
""",
    "never closed": """
loop = asyncio.new_event_loop()
loop.run_until_complete(main())
for task in asyncio.all_tasks(loop):
    task._log_destroy_pending = False
""",
    "one loop after another": "for _ in range(3): asyncio.run(main())",
}
ASYNCHRONOUS = """
import asyncio, sys, uvloop
from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import AsyncTransformClient

link = StampedTransform("a", "b", 0, Transform())
tasks = set()

async def main():
    tf = await AsyncTransformClient.connect(sys.argv[1])
    sensor = await tf.broadcaster("sensor")
    sensor.send_static(link)
    for _ in range(20):
        for call in (tf.lookup_transform("a", "never", timeout_s=100),
                     tf.lookup_transform("a", "b"), tf.set_transform(link), tf.frames(),
                     asyncio.to_thread(sensor.send, link)):
            tasks.add(asyncio.create_task(call))
    await asyncio.sleep(float(sys.argv[2]))
    for task in tasks:
        if task.done() and not task.cancelled():
            task.exception()

"""


def run(script: str, *arguments: str, status: int = 0) -> None:
    done = subprocess.run(
        [sys.executable, "-c", script, *arguments],
        capture_output=True,
        text=True,
        timeout=150,
        check=False,
    )
    assert (done.returncode, done.stderr) == (status, "")


def run_under_load(script: str, *arguments: str) -> None:
    """Several at once, several times."""
    with ThreadPoolExecutor(TOGETHER) as processes:
        for ended in [processes.submit(run, script, *arguments) for _ in range(RUNS)]:
            ended.result()


@pytest.fixture
def endpoint(shared_server: ServerProcess) -> str:
    return shared_server.endpoint


def test_daemon_threads_that_wait_for_a_transform() -> None:
    for _ in range(5):
        run(DAEMONS_THAT_WAIT)


@pytest.mark.parametrize("left_open", NEVER_CLOSED)
def test_what_is_never_closed(endpoint: str, left_open: str) -> None:
    run_under_load(CONNECT + NEVER_CLOSED[left_open] + "\ntime.sleep(0.35)\n", endpoint)


@pytest.mark.parametrize("left_open", ["broadcaster with statics", "mirrors"])
def test_what_is_never_closed_in_a_script_that_ends_at_once(endpoint: str, left_open: str) -> None:
    run_under_load(CONNECT + NEVER_CLOSED[left_open], endpoint)


@pytest.mark.parametrize("loop_ends", LOOP_ENDS)
@pytest.mark.parametrize("after_s", ["0.002", "0.3"])
def test_an_event_loop_ends_with_calls_under_way(
    endpoint: str, loop_ends: str, after_s: str
) -> None:
    with ThreadPoolExecutor(TOGETHER) as processes:
        script = ASYNCHRONOUS + LOOP_ENDS[loop_ends]
        for ended in [processes.submit(run, script, endpoint, after_s) for _ in range(2)]:
            ended.result()


def test_an_exit_handler_may_wait_for_a_thread_that_uses_the_client(endpoint: str) -> None:
    """Exit handlers that were registered before the client's run after it."""
    script = (
        """
import atexit
atexit.register(lambda: thread.join(20))
"""
        + CONNECT
        + """
def wait():
    try:
        tf.lookup_transform("a", "never", timeout_s=100)
    except TransformException as error:
        print(type(error).__name__, flush=True)

thread = threading.Thread(target=wait, daemon=True)
thread.start()
time.sleep(0.2)
"""
    )
    run(script, endpoint)


def test_an_unreferenced_client_is_collected(endpoint: str) -> None:
    """The exit handler and the threads of broadcasters hold clients by weak references."""
    run(
        CONNECT
        + """
import gc, weakref
broadcaster = tf.broadcaster("sensor")
broadcaster.send_static(link)
gone = [weakref.ref(tf), weakref.ref(broadcaster)]
del tf, broadcaster
gc.collect()
assert [ref() for ref in gone] == [None, None]
end = time.monotonic() + 10
while "announce statics" in {thread.name for thread in threading.enumerate()}:
    assert time.monotonic() < end, "the thread of a collected broadcaster is running"
    time.sleep(0.01)
""",
        endpoint,
    )


def test_an_unreferenced_client_of_a_loop_is_collected(endpoint: str) -> None:
    run(
        """
import asyncio, gc, os, sys, time, weakref
from zenoh_tf_client import AsyncTransformClient

async def main():
    for _ in range(3):
        tf = await AsyncTransformClient.connect(sys.argv[1])
        assert await tf.frames() is not None
        gone = weakref.ref(tf), weakref.ref(tf._connection._transport)
        del tf
        end = time.monotonic() + 10
        while any(ref() for ref in gone):
            assert time.monotonic() < end
            gc.collect()
            await asyncio.sleep(0.01)

asyncio.run(main())
""",
        endpoint,
    )


COLLECTED = """
import atexit, gc, threading, time
atexit.register(lambda: print("end", flush=True))  # after the exit handler of the package
from zenoh_tf._zenoh.calls import SessionCalls

class Connection:
    def __init__(self):
        self.calls = SessionCalls(self.close_session)
        self.ring = self

    def close_session(self):
        print("closes", flush=True)
        time.sleep(0.5)
        print("closed", flush=True)

    def __del__(self):
        self.calls.close()

Connection()
threading.Thread(target=gc.collect, daemon=True).start()
time.sleep(0.1)
"""


def test_the_end_waits_for_what_the_garbage_collector_closes() -> None:
    """It clears weak references first, so the exit handler must know the session otherwise."""
    done = subprocess.run(
        [sys.executable, "-c", COLLECTED],
        check=True,
        timeout=150,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert done.stdout.split() == ["closes", "closed", "end"]


def test_the_exit_status_is_the_scripts_own(endpoint: str) -> None:
    script = CONNECT + NEVER_CLOSED["daemon threads that read"] + "\nsys.exit(3)\n"
    for _ in range(RUNS):
        run(script, endpoint, status=3)


#: Nobody answers at an address of TEST-NET-1, nor at a port where nothing listens.
@pytest.mark.parametrize("nobody", ["tcp/192.0.2.1:7447", "tcp/127.0.0.1:9"])
def test_connect_hears_ctrl_c(nobody: str) -> None:
    run(
        """
import os, signal, sys, threading, time
from zenoh_tf_client import TransformClient
threading.Timer(0.5, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
try:
    TransformClient.connect(sys.argv[1], timeout_s=450)  # far beyond this test's own time-out
except KeyboardInterrupt:
    sys.exit(5)
""",
        nobody,
        status=5,
    )


def test_a_frozen_server_does_not_hold_up_a_program_that_ends(
    start_server: StartServer,
) -> None:
    """A thread is blocked in a put, which Zenoh gives up after 5 s, and a close after 10 s."""
    frozen = start_server()
    script = (
        CONNECT
        + """
import os, signal
rows = [StampedTransform("a", f"b{row}", 1, Transform()) for row in range(10_000)]
sensor = tf.broadcaster("sensor")
def send():
    try:
        sensor.send(rows)
    except TransformException:
        time.sleep(60)
forever(send)
time.sleep(0.3)
os.kill(int(sys.argv[2]), signal.SIGSTOP)
time.sleep(1.0)
if sys.argv[3] == "close":
    tf.close()
"""
    )
    for how in ("close", "exit"):
        run(script, frozen.endpoint, str(frozen.process.pid), how)
        frozen.send_signal(signal.SIGCONT)
