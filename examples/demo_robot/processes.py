"""A demo's child processes, which end with it, however it ends."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any

from demo_robot import page
from zenoh_tf import TransformException
from zenoh_tf_client import TransformClient

EXAMPLES = Path(__file__).resolve().parent.parent


#: The signals that end a program and that it can handle.
_END_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class ChildFailed(Exception):
    """A child process failed, or ended too early."""


class Child:
    """One Python module running as a process."""

    def __init__(self, module: str, *args: str) -> None:
        self.name = " ".join([module, *args[:1]])
        # Files, not pipes: nothing reads while the child runs, and a full pipe would block it.
        self._out = tempfile.TemporaryFile("w+")  # noqa: SIM115 - closed in end()
        self._err = tempfile.TemporaryFile("w+")  # noqa: SIM115
        self._process = subprocess.Popen(
            [sys.executable, "-m", module, *args],
            cwd=EXAMPLES,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
            stdin=subprocess.DEVNULL,
            stdout=self._out,
            stderr=self._err,
            # Ctrl-C reaches the demo alone, which then ends its children in order.
            start_new_session=True,
        )

    def check(self) -> None:
        """Raises ChildFailed if the process has ended."""
        if self._process.poll() is not None:
            raise ChildFailed(f"{self.name} ended: {self._last_error_line()}")

    def terminate(self) -> None:
        self._process.terminate()

    def report(self, timeout_s: float = 20.0) -> dict[str, Any]:
        """Wait for the end of the process; return the JSON line that it printed last."""
        try:
            status = self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            raise ChildFailed(f"{self.name} did not end within {timeout_s:g} s") from None
        if status != 0:
            raise ChildFailed(f"{self.name} failed: {self._last_error_line()}")
        self._out.seek(0)
        result: dict[str, Any] = json.loads(self._out.read().strip().splitlines()[-1])
        return result

    def end(self) -> None:
        """End the process by SIGTERM, or by SIGKILL after 3 s."""
        if self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(3.0)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        self._out.close()
        self._err.close()

    def _last_error_line(self) -> str:
        self._err.seek(0)
        lines = self._err.read().strip().splitlines()
        return lines[-1] if lines else "it printed no error"


class Children:
    """Starts processes. A context manager, which ends all of them, the last one first."""

    def __init__(self) -> None:
        self._children: list[Child] = []

    def __enter__(self) -> Children:
        # Otherwise `kill`, or a closed terminal, would end the demo and leave its children.
        for number in _END_SIGNALS:
            signal.signal(number, _interrupt)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        # A second Ctrl-C must not interrupt this.
        for number in _END_SIGNALS:
            signal.signal(number, signal.SIG_IGN)
        for child in reversed(self._children):
            child.end()

    def start(self, module: str, *args: str) -> Child:
        child = Child(module, *args)
        self._children.append(child)
        return child

    def start_server(self, *flags: str) -> tuple[Child, str, TransformClient]:
        """Start a server; return it, its endpoint, and a client of it."""
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
        server = self.start("zenoh_tf_server", "--listen", endpoint, *flags)
        try:
            return server, endpoint, TransformClient.connect(endpoint, timeout_s=10.0)
        except TransformException:
            server.check()  # the server's own error says more
            raise


def run_demo(demo: Callable[[Children], None]) -> int:
    """Run a demo, and end its processes; return the exit status."""
    start_s = time.monotonic()
    try:
        with Children() as children:
            demo(children)
    except KeyboardInterrupt:
        print("\ninterrupted; all processes have ended", file=sys.stderr)
        return 130
    except (ChildFailed, TransformException) as error:
        print(f"\nthe demo failed: {type(error).__name__}: {error}", file=sys.stderr)
        return 1
    print(page.faint(f"  All processes have ended; {time.monotonic() - start_s:.0f} s in all.\n"))
    return 0


def _interrupt(*_: object) -> None:
    raise KeyboardInterrupt
