"""Errors of a command that the server did not report."""


class CommandError(Exception):
    """An error that the command line reports; the command ends with exit code 1."""
