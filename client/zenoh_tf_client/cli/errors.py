"""How commands end that do not succeed, apart from what the server reports."""

from __future__ import annotations

from typing import Final

#: The exit code of a command whose answer is that something is wrong.
FAULT_FOUND: Final = 3


class CommandError(Exception):
    """An error that the command line reports; the command ends with exit code 1."""
