"""Access rules: which clients may do what. They come from `[[access]]` of a configuration file.

    [[access]]
    users = ["nav"]                  # users of --users; left out: every user
    certificates = ["nav.example"]   # common names of clients' certificates; left out: all
    may = ["read"]                   # any of RIGHTS
    publish = ["wheels", "arm-*"]    # the authorities that they may publish as

A client may do what any rule that matches it allows, and nothing else. A rule with users and
certificates matches a client that has both.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final, NoReturn

from zenoh_tf._net import keys
from zenoh_tf.errors import InvalidArgumentException

#: Right -> meaning.
RIGHTS: Final = {
    "read": "look up transforms, and ask what the tree holds",
    "listen": "subscribe to all published transforms on Zenoh",
    "clear": "forget all samples",
    "reset": "drop all frames",
    "remove_frame": "remove a frame",
}
_FIELDS: Final = ("users", "certificates", "may", "publish")


@dataclass(frozen=True, slots=True)
class AccessRule:
    """What some clients may do."""

    users: tuple[str, ...] = ()  # empty: every user
    certificates: tuple[str, ...] = ()  # empty: every certificate, and clients without one
    may: frozenset[str] = frozenset()
    publish: tuple[str, ...] = ()  # names of authorities; a '*' at the end stands for any text

    def matches(self, user: str | None, certificate: str | None) -> bool:
        """True if the rule is for a client with this user and this certificate's common name."""
        return (not self.users or user in self.users) and (
            not self.certificates or certificate in self.certificates
        )


#: What a client that has proved who it is may do if there are no rules.
EVERYTHING: Final = AccessRule(may=frozenset(RIGHTS), publish=("*",))


def granted(
    rules: Iterable[AccessRule], user: str | None, certificate: str | None
) -> dict[str, list[str]]:
    """What a client may do: the rights `may` and the authorities `publish`, each sorted."""
    mine = [rule for rule in rules if rule.matches(user, certificate)]
    return {
        "may": sorted({right for rule in mine for right in rule.may}),
        "publish": sorted({authority for rule in mine for authority in rule.publish}),
    }


def authority_chunk(pattern: str) -> str:
    """The key chunk of the authorities that a pattern of `publish` names.

    Only a '*' at the end stands for any text: elsewhere it could match half of an escape.
    """
    prefix = pattern.removesuffix("*")
    if prefix == pattern:
        return keys.escape(pattern, "authority")
    return keys.escape(prefix, "authority") + "$*" if prefix else "*"


def parse(tables: Any) -> tuple[AccessRule, ...]:
    """The rules in the `[[access]]` tables of a configuration file.

    Raises:
        InvalidArgumentException: A table is wrong; the message says which and why.
    """
    if not isinstance(tables, list) or not all(isinstance(each, dict) for each in tables):
        _reject("write access rules as tables [[access]]")
    return tuple(_rule(table, f"access rule {number}") for number, table in enumerate(tables, 1))


def _rule(table: Mapping[str, Any], name: str) -> AccessRule:
    for key in table:
        if key not in _FIELDS:
            _reject(f"{name} has the unknown key {key!r}: use {', '.join(_FIELDS)}")
    lists = {field: _texts(table, field, name) for field in _FIELDS}
    for field in ("users", "certificates"):
        if field in table and not lists[field]:
            _reject(f"{name}: {field} is empty; leave it out if the rule is for all of them")
    for right in lists["may"]:
        if right not in RIGHTS:
            _reject(f"{name}: there is no right {right!r}: use {', '.join(RIGHTS)}")
    for pattern in lists["publish"]:
        if "*" in pattern[:-1]:
            _reject(f"{name}: in publish {pattern!r} a '*' is allowed at the end only")
        authority_chunk(pattern)
    return AccessRule(
        tuple(lists["users"]),
        tuple(lists["certificates"]),
        frozenset(lists["may"]),
        tuple(lists["publish"]),
    )


def _texts(table: Mapping[str, Any], field: str, name: str) -> list[str]:
    values = table.get(field, [])
    if not isinstance(values, list) or not all(isinstance(value, str) for value in values):
        _reject(f"{name}: {field} must be a list of texts, not {values!r}")
    return list(values)


def _reject(reason: str) -> NoReturn:
    raise InvalidArgumentException(reason, field="access")
