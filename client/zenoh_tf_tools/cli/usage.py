"""How the command line reports wrong usage: what is wrong first, then how the command is called."""

from __future__ import annotations

import argparse
import re
from typing import Any, Final, NoReturn

from zenoh_tf.text import quoted
from zenoh_tf.text.similar import did_you_mean
from zenoh_tf_tools.cli import output

#: argparse's words for a value that is none of a list, such as a misspelt command.
_CHOICE: Final = re.compile(
    r"argument (?P<what>.+?): invalid choice: '(?P<given>.*)' \(choose from (?P<names>.*)\)"
)
_UNKNOWN: Final = re.compile(r"unrecognized arguments: (?P<option>--[\w-]+)")
_OPTION: Final = re.compile(r"--[a-z][a-z-]*")
#: An option, or a choice of several, as argparse's usage shows it.
_OPTIONAL: Final = re.compile(r"\[-[^\[\]]*(\[[^\[\]]*\][^\[\]]*)*\]")


class UsageParser(argparse.ArgumentParser):
    """Reports what is wrong, with the name that may be meant, and the usage in short. A command's
    options may stand between its arguments."""

    _is_mixing = False
    _has_usage = False

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        # A parser of commands leaves the rest to theirs; after -- all are arguments.
        if self._is_mixing or self._subparsers is not None or "--" in (args or ()):
            return super().parse_known_args(args, namespace)
        self._is_mixing, self._has_usage = True, self.usage is not None
        return self.parse_known_intermixed_args(args, namespace)  # which calls this, and sets usage

    def error(self, message: str) -> NoReturn:
        call = self.format_usage().rstrip()
        if not self._has_usage:  # else it is short
            arguments = _OPTIONAL.sub("", call).split()[1 + len(self.prog.split()) :]
            call = " ".join([f"usage: {self.prog} [options]", *arguments])
        self.exit(
            2,
            f"{self.prog}: error: {self.explained(message)}\n{call}\n"
            f"{self.prog} --help lists the options\n",
        )

    def explained(self, message: str) -> str:
        """The message, with the command or the option that may be meant."""
        if choice := _CHOICE.fullmatch(message):
            question = did_you_mean(choice["given"], re.findall(r"'([^']*)'", choice["names"]))
            if choice["what"] not in ("COMMAND", "ACTION"):
                return message if question is None else f"{message}; {question}"
            end = question or f"{self.prog} --help lists all"
            return f"there is no {choice['what'].lower()} {quoted(choice['given'])}; {end}"
        if unknown := _UNKNOWN.match(message):
            question = did_you_mean(unknown["option"], {*_OPTION.findall(self.format_help())})
            return message if question is None else f"{message}; {question}"
        return message


class JsonUsageParser(UsageParser):
    """Reports wrong usage as JSON."""

    def error(self, message: str) -> NoReturn:
        text = self.explained(message)
        output.print_error("UsageError", text, {}, as_json=True, shown=text)
        self.exit(2)
