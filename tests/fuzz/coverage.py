"""``python -m tests.fuzz.coverage TARGET [FLAGS]``: coverage-guided fuzzing, by Atheris.

Starts from the kept corpus and real messages. New inputs stay in build/fuzz/TARGET; copy those that
are worth keeping to tests/fuzz/corpus. Flags are those of libFuzzer. Needs the extra
``zenoh-tf[fuzz]``.
"""

from __future__ import annotations

import inspect
import sys
from pathlib import Path

try:
    import atheris
except ImportError as error:
    raise SystemExit("Atheris is missing: pip install 'zenoh-tf[fuzz]'") from error

from .corpus import CORPUS, first_inputs
from .targets import TARGETS

_FOUND = Path("build/fuzz")


def _instrument() -> None:
    """Count coverage in all of the project's Python functions. Atheris cannot do that while it
    imports them, because an editable installation has a loader of its own."""
    for name, module in list(sys.modules.items()):
        if name.partition(".")[0] not in ("zenoh_tf", "zenoh_tf_server"):
            continue
        for thing in list(vars(module).values()):
            members = list(vars(thing).values()) if inspect.isclass(thing) else [thing]
            for member in members:
                if inspect.isfunction(member) and member.__module__ == name:
                    atheris.instrument_func(member)


def main() -> None:
    name, *flags = sys.argv[1:]
    _instrument()
    found = _FOUND / name
    found.mkdir(parents=True, exist_ok=True)
    for index, data in enumerate(first_inputs(name)):
        (found / f"seed-{index}").write_bytes(data)
    corpus = CORPUS / name
    corpus.mkdir(exist_ok=True)
    # libFuzzer writes what is new into the first folder.
    arguments = [sys.argv[0], *flags, f"-artifact_prefix={found}/", "-max_len=4096", "-timeout=20"]
    arguments += [str(found), str(corpus)]
    target = TARGETS[name]

    def run(data: bytes) -> None:
        target(data)

    atheris.Setup(arguments, run)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
