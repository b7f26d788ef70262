"""The error of a recording that cannot be read or written, and of a library that is missing."""

from __future__ import annotations

from zenoh_tf.text.extras import pip_install


class RecordingError(Exception):
    """A recording cannot be read, or has no transforms. The message begins with its path."""


def missing_library(error: ImportError) -> RecordingError:
    """The error for a library of the extra that cannot be imported."""
    return RecordingError(
        f"recordings need a library that cannot be imported ({error}); install it with: "
        f"{pip_install('recordings')}"
    )
