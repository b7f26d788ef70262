"""The page of built-in faults: ``python -m tests.mutation.fault_page > tests/faults.md``.

``make lint`` compares the page with the tables.
"""

from __future__ import annotations

from collections.abc import Iterator

from tests.chaos import faults as chaos
from tests.history import faults as history

_INTRODUCTION = """\
# Built-in faults

A test that never fails proves little. So the slow tests build a copy of the core or of the server
with each of these faults in turn, and must find it: see [testing](../docs/explanation/testing.md).
`make test` checks that each fault still fits the code. This page is made from the tables of faults.
"""

_CORE = """
## In the core

`tests/history/test_faults.py::test_a_fault_is_found[NAME]` finds the fault of that name in the
histories that a faulty core records. The table is `tests/history/faults.py`.

| name | where | found with | by lookups in |
|---|---|---|---|
"""

_SERVER = """
## In the server

`tests/chaos/test_chaos.py::test_a_faulty_server_is_found[NAME]` finds the fault of that name in
what the clients of a faulty server read. The table is `tests/chaos/faults.py`.

| name | where |
|---|---|
"""


def page() -> Iterator[str]:
    """The lines of the page."""
    yield from _INTRODUCTION.splitlines()
    yield from _CORE.splitlines()
    for fault in history.FAULTS:
        modes = ", ".join(f"`{mode}`" for mode in fault.modes)
        yield f"| {fault.name} | `zenoh_tf/core/{fault.file}` | {modes} | the {fault.reads} |"
    yield from _SERVER.splitlines()
    for server_fault in chaos.FAULTS:
        file, _ = chaos.faulty_text(server_fault)
        yield f"| {server_fault.name} | `server/zenoh_tf_server/{file}` |"


if __name__ == "__main__":
    print(*page(), sep="\n")
