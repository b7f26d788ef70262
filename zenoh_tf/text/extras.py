"""How an extra of this package is installed."""

from __future__ import annotations


def pip_install(extra: str) -> str:
    """The command, in both forms: not every user has the package from an index."""
    return f"pip install 'zenoh-tf[{extra}]', or in a checkout: pip install '.[{extra}]'"
