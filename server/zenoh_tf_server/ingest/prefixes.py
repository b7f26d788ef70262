"""Names of frames: which prefix a robot's frames get (``--ros2-prefix``, ``--ros2-shared``).

Robots whose trees are mirrored get theirs by the same rules (federation/rows.py).

A rule names a robot by its namespace, domain or Zenoh session. Rules for one robot come before
those for all; among equals the session comes before the namespace, and that before the domain.

Thread safety: all methods.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from zenoh_tf.errors import InvalidArgumentException
from zenoh_tf.ros2.keys import Topic
from zenoh_tf.text import quoted

KINDS: Final = ("session", "namespace", "domain")
_PREFIX: Final = re.compile(r"[^/\x00-\x20\x7f]+(?:/[^/\x00-\x20\x7f]+)*")
#: Names whose result is remembered, per publisher.
_KNOWN_NAMES: Final = 4096


@dataclass(frozen=True, slots=True)
class PrefixRule:
    """``KIND`` for every robot, or ``KIND:VALUE=PREFIX`` for one."""

    kind: str
    value: str | None = None  # None: whatever it is, it is the prefix as well
    prefix: str = ""


def parse_rule(text: str) -> PrefixRule:
    """The rule that a flag's value says: a type for argparse."""
    kind, colon, rest = text.partition(":")
    value, equals, prefix = rest.partition("=")
    value, prefix = value.strip("/"), prefix.strip("/")
    if kind not in KINDS or (colon and not (value and equals and _PREFIX.fullmatch(prefix))):
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not a rule: use namespace, domain or session, or one of them for "
            "a single robot, such as namespace:robot1=r1"
        )
    return PrefixRule(kind, value, prefix) if colon else PrefixRule(kind)


class Prefixes:
    """Applies the rules."""

    def __init__(self, rules: Sequence[PrefixRule] = (), shared: Sequence[str] = ()) -> None:
        """`shared`: frames that all robots have in common, and that get no prefix."""
        self._shared = frozenset(name.strip("/") for name in shared)
        self._rules = sorted(rules, key=lambda rule: (rule.value is None, KINDS.index(rule.kind)))

    def prefix(self, topic: Topic, zid: str | None) -> str:
        """The prefix of a publisher's frames; "" for none.

        Raises:
            InvalidArgumentException: A rule needs the publisher's session, which is not known.
        """
        values = {
            "session": zid or "",
            "namespace": topic.namespace,
            "domain": "" if topic.domain is None else str(topic.domain),
        }
        for rule in self._rules:
            value = values[rule.kind]
            if rule.kind == "session" and not value:
                raise InvalidArgumentException(
                    f"the Zenoh session that publishes {topic.path} is not known, so its frames "
                    "cannot get the prefix of --ros2-prefix session: is the extra "
                    "zenoh-tf[ros2] installed?",
                    field="ros2_prefix",
                )
            if rule.value is None and value:
                return value
            if rule.value is not None and rule.value == value:
                return rule.prefix
        return ""

    def renamer(self, prefix: str) -> Callable[[list[str]], list[str]]:
        """A function that gives a message's frames their names in the tree.

        It strips a leading slash, which tf2 does not allow any more, and prefixes what is not
        shared and has no such prefix yet.
        """
        known: dict[str, str] = {}
        shared, begin = self._shared, f"{prefix}/"

        def rename(name: str) -> str:
            bare = name.lstrip("/")
            if prefix and bare and bare not in shared and not bare.startswith(begin):
                bare = begin + bare
            if len(known) < _KNOWN_NAMES:
                known[name] = bare
            return bare

        def rename_all(names: list[str]) -> list[str]:
            return [known.get(name) or rename(name) for name in names]

        return rename_all
