"""Programs that a benchmark starts: they are ready at their first line, and answer by lines."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from importlib import import_module
from typing import Any

from bench.machine import ROOT


class Process(subprocess.Popen[str]):
    """A program that prints a line when it is ready, and answers each line of its stdin with a
    line of JSON. Leaving the context ends it."""

    def __init__(self, *command: str, wait: bool = True) -> None:
        pipe = subprocess.PIPE
        super().__init__(command, cwd=ROOT, stdin=pipe, stdout=pipe, text=True)
        if wait:
            self.read_line()

    @classmethod
    def of(cls, function: Callable[..., object], *arguments: object) -> Process:
        """A call of a module's function as a process; JSON can hold the arguments."""
        where = (function.__module__, function.__name__)
        return cls(sys.executable, "-m", __name__, *where, *map(json.dumps, arguments))

    def read_line(self) -> str:
        """The next line that it prints; ends the benchmark if it has ended."""
        assert self.stdout is not None
        if line := self.stdout.readline():
            return line
        raise SystemExit(f"{self.args!r} ended with code {self.wait()}")

    def send(self, line: object) -> None:
        print(line, file=self.stdin, flush=True)

    def ask(self, line: object = "") -> Any:
        self.send(line)
        return json.loads(self.read_line())

    def __exit__(self, *error: object) -> None:
        self.terminate()
        super().__exit__(*error)  # type: ignore[arg-type]


def serve(answer: Callable[[str], object]) -> None:
    """What such a program does: it answers each line."""
    print("ready", flush=True)
    for line in sys.stdin:
        print(json.dumps(answer(line)), flush=True)


if __name__ == "__main__":
    module, name, *texts = sys.argv[1:]
    getattr(import_module(module), name)(*map(json.loads, texts))
