"""What the declarations of the command families share."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any, TypeAlias

if TYPE_CHECKING:
    # The class is generic only for the type checker.
    Commands: TypeAlias = argparse._SubParsersAction[argparse.ArgumentParser]
else:
    Commands = object


def examples(*lines: str) -> dict[str, Any]:
    """Arguments of `add_parser` that show command lines below the help."""
    return {
        "epilog": "\n".join(["examples:", *(f"  {line}" for line in lines)]),
        "formatter_class": argparse.RawDescriptionHelpFormatter,
    }
