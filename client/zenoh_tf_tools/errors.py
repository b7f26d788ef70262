"""How commands end that do not succeed, apart from what the server reports."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from zenoh_tf.text.extras import pip_install

#: The exit code of a command whose answer is that something is wrong.
FAULT_FOUND: Final = 3


class CommandError(Exception):
    """An error that the command line reports; the command ends with exit code 1."""


@contextmanager
def extra(name: str, module: str) -> Iterator[None]:
    """Report in plain words that an import needs an extra; `module`: its top-level module."""
    try:
        yield
    except ModuleNotFoundError as error:
        if error.name is None or error.name.split(".")[0] != module:
            raise
        raise CommandError(
            f"this command needs {module}, which is not installed; install it with: "
            f"{pip_install(name)}"
        ) from error
