"""``python -m tests.fuzz.coverage TARGET [FLAGS]``: coverage-guided fuzzing, by Atheris.

Starts from the kept corpus and real messages. New inputs stay in build/fuzz/TARGET; those that are
worth keeping are copied to the corpus by `-merge=1`. Flags are those of libFuzzer. Needs the extra
``zenoh-tf[fuzz]``.
"""

from __future__ import annotations

import sys
from pathlib import Path

try:
    import atheris
except ImportError as error:
    raise SystemExit("Atheris is missing: pip install 'zenoh-tf[fuzz]'") from error

with atheris.instrument_imports(include=["zenoh_tf", "zenoh_tf_server", "msgpack"]):
    from .targets import TARGETS

from .corpus import CORPUS, first_inputs

_FOUND = Path("build/fuzz")


def main() -> None:
    name, *flags = sys.argv[1:]
    found = _FOUND / name
    found.mkdir(parents=True, exist_ok=True)
    for index, data in enumerate(first_inputs(name)):
        (found / f"seed-{index}").write_bytes(data)
    corpus = CORPUS / name
    corpus.mkdir(exist_ok=True)
    arguments = [sys.argv[0], *flags, f"-artifact_prefix={found}/"]
    arguments += ["-max_len=4096", "-timeout=20", str(found), str(corpus)]
    target = TARGETS[name]

    def run(data: bytes) -> None:
        target(data)

    atheris.Setup(arguments, run)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
