"""What an exception says, for a sentence of ours."""

from __future__ import annotations


def reason(error: BaseException) -> str:
    """What a library's exception says, in one line; some say nothing."""
    return " ".join(str(error).split()) or type(error).__name__
