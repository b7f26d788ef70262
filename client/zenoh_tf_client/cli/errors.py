"""Failures of a command that are not the service's."""


class CommandError(Exception):
    """Printed as one line on stderr; the command ends with exit code 1."""
