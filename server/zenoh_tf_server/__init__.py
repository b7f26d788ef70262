"""The service: a transform tree behind Zenoh queryables. `main` starts it."""
