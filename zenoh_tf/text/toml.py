"""TOML, read by the standard library, or on Python 3.10 by tomli if that is installed."""

from __future__ import annotations

import sys
from typing import Any


class NoReader(ValueError):
    """Nothing here reads TOML."""


def loads(text: str) -> dict[str, Any]:
    """Raises NoReader, or another ValueError if the text is not TOML."""
    try:
        if sys.version_info >= (3, 11):
            import tomllib
        else:
            import tomli as tomllib
    except ModuleNotFoundError as error:
        raise NoReader("Python 3.10 reads TOML by tomli: pip install tomli") from error
    return tomllib.loads(text)
