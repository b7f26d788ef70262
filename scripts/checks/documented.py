"""What pages say of the program: its flags, their defaults, its limits."""

from __future__ import annotations

import argparse
import re
import shlex
from collections.abc import Iterator

from zenoh_tf_server import flags as server_flags
from zenoh_tf_server.limits import SETTABLE
from zenoh_tf_tools.cli.main import _parser

from .repository import Repository, Violation

FLAG = r"--[a-z][a-z0-9-]*"
#: Flags of other programs that pages name.
OF_OTHERS = {
    *("--build", "--rm", "--privileged", "--cap-add", "--pid", "--ipc", "--group-add"),
    *("--python", "--case", "--quick", "--results", "--plot", "--seconds", "--check"),
}


def parsers() -> dict[str, argparse.ArgumentParser]:
    """The server's parser and that of each command, by the words that call it."""
    found = {"zenoh-tf-server": server_flags.parser()}
    found |= {"zenoh-tf": _parser()} | dict(_commands("zenoh-tf", _parser()))
    return found


def _commands(
    words: str, parser: argparse.ArgumentParser
) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, child in action.choices.items():
                yield f"{words} {name}", child
                yield from _commands(f"{words} {name}", child)


def options(parser: argparse.ArgumentParser) -> dict[str, argparse.Action]:
    return {text: action for action in parser._actions for text in action.option_strings}


def flags(repository: Repository) -> Iterator[Violation]:
    """Each flag on a page is one of the program that the page calls with it."""
    by_words = parsers()
    known = {flag for parser in by_words.values() for flag in options(parser)} | OF_OTHERS
    for page in repository.pages():
        for number, line in repository.lines(page):
            for code in re.findall(r"`([^`]+)`", line) or [line]:
                for flag in re.findall(rf"(?<![\w-]){FLAG}", code):
                    if code.startswith("--") and flag not in known:
                        yield Violation(page, number, f"no program here has the flag {flag}")
                for command in re.findall(r"(?:^|[\s$(])(zenoh-tf(?:-server)? [^|&;)`]*)", code):
                    for problem in _call_problems(command, by_words):
                        yield Violation(page, number, problem)


def _call_problems(command: str, by_words: dict[str, argparse.ArgumentParser]) -> Iterator[str]:
    """What is wrong with a call such as ``zenoh-tf view --port 8080``."""
    try:
        words = shlex.split(command, comments=True)
    except ValueError:  # a quote that the line does not close
        return
    name, allowed = words[0], set(options(by_words[words[0]]))
    for word in words[1:]:
        if f"{name} {word}" in by_words:
            name = f"{name} {word}"
            allowed |= set(options(by_words[name]))
        flag = word.partition("=")[0]
        if re.fullmatch(FLAG, flag) and flag not in allowed:
            yield f"{name} has no flag {flag}"


def limits(repository: Repository) -> Iterator[Violation]:
    """A limit that a page or a message names exists."""
    known = set(SETTABLE) - {"memory"}
    sources = repository.files(".py", ".cpp", ".hpp", under=["zenoh_tf", "server", "client"])
    for path in (*repository.pages(), *sources):
        for number, line in repository.lines(path):
            for name in re.findall(r"--limit ([a-z]\w*)", line):
                if name not in known:
                    yield Violation(path, number, f"there is no limit {name}")


def defaults(repository: Repository) -> Iterator[Violation]:
    """A default that a page states is the code's."""
    known: dict[str, list[str]] = {}
    for parser in parsers().values():
        for flag, action in options(parser).items():
            known.setdefault(flag, []).append(str(action.default))
    patterns = (
        rf"`({FLAG})` \(default:? `?([\w./:]+)`?",  # `--flag` (default 3)
        rf"`({FLAG}) ([\w./:]+)` \(default\)",  # `--flag value` (default)
        rf"`({FLAG})`: `([\w./:]+)` \(default\)",  # `--flag`: `value` (default)
    )
    for page in repository.pages():
        for number, line in repository.lines(page):
            for flag, value in (pair for each in patterns for pair in re.findall(each, line)):
                codes = known.get(flag, [])
                if not any(_equal(value, code) for code in codes):
                    problem = f"the default of {flag} is {' or '.join(codes)}, not {value}"
                    yield Violation(page, number, problem)


def _equal(stated: str, default: str) -> bool:
    try:
        return float(stated.replace(",", "")) == float(default)
    except ValueError:
        return stated == default
