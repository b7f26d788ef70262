"""The program `reader.cpp`, which reads and writes trees by the C++ header, as a process."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path
from types import TracebackType

ROOT = Path(__file__).resolve().parents[2]
#: `make setup` builds it with the C++ tests.
PROGRAM = ROOT / "build/core-plain/c_api/c_reader"


class Reader:
    """Commands to the program, one after the other."""

    #: Sends a query of the program: key, payload, seconds to the reply's payload, b"" for none.
    query: Callable[[str, bytes, float], bytes]

    def __init__(self) -> None:
        self.process = subprocess.Popen(
            [PROGRAM], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def ask(self, *words: object) -> tuple[str, list[str]]:
        """Return the code, or "ok", and the words of the reply."""
        assert self.process.stdin is not None and self.process.stdout is not None
        self.process.stdin.write(" ".join(map(str, words)) + "\n")
        self.process.stdin.flush()
        while (line := self.process.stdout.readline()).startswith("query "):
            _, key, payload, timeout_ms = line.split()
            answer = self.query(key, bytes.fromhex(payload), int(timeout_ms) / 1000)
            self.process.stdin.write(answer.hex() + "\n")
            self.process.stdin.flush()
        assert line, f"the reader ended: {self.process.wait()}"
        code, *reply = line.split()
        return code, reply

    def do(self, *words: object) -> list[str]:
        """The same of a command that must succeed."""
        code, reply = self.ask(*words)
        assert code == "ok", (words, code, reply)
        return reply

    def __enter__(self) -> Reader:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.process.communicate()
        assert error is not None or self.process.returncode == 0
