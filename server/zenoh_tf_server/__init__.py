"""The service: a transform tree behind Zenoh queryables. `main` starts it."""

from zenoh_tf import __version__

__all__ = ["__version__"]
