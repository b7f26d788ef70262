"""Access rules as a configuration of Zenoh's access control, which the embedded router enforces.

Zenoh knows a client by its user and its certificate, and allows or drops each of its messages by
kind and key. So each right is a set of keys. Everything is denied that no rule allows: other keys
of the router, other servers' tokens, and queryables on the service's keys, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from zenoh_tf._net import keys

from . import access_rules
from .access_rules import EVERYTHING, AccessRule

#: Requests that change nothing, except `hello`, which every client may ask.
READS: Final = ("lookup", "batch", "info", "snapshot", "missed")
#: Requests whose keys name what is written, once there are rules.
KEYED: Final = ("commit", "batch", "admin")


def zenoh_settings(tree: str, rules: Sequence[AccessRule]) -> dict[str, Any]:
    """The value of `access_control`. Without rules, a client that is let in may do everything."""
    grants = [(AccessRule(), _for_all(tree))]
    for rule in rules or [EVERYTHING]:
        grants.append((rule, _rights(tree, rule, keyed=bool(rules))))
    allowed: list[dict[str, Any]] = []
    subjects: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    for rule, rights in grants:
        if not rights:
            continue
        selectors = {"usernames": rule.users, "cert_common_names": rule.certificates}
        subject = {name: list(values) for name, values in selectors.items() if values}
        ids = [f"right {number}" for number in range(len(allowed), len(allowed) + len(rights))]
        allowed += (right | {"id": id_} for right, id_ in zip(rights, ids, strict=True))
        subjects.append(subject | {"id": f"subject {len(subjects)}"})
        policies.append({"rules": ids, "subjects": [subjects[-1]["id"]]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": allowed,
        "subjects": subjects,
        "policies": policies,
    }


def _right(flow: str, messages: Sequence[str], key_exprs: Sequence[str]) -> dict[str, Any]:
    return {
        "permission": "allow",
        "flows": [flow],
        "messages": list(messages),
        "key_exprs": list(key_exprs),
    }


def _for_all(tree: str) -> list[dict[str, Any]]:
    """What every client needs to find the server and to learn its own rights."""
    everything = f"{keys.prefix(tree)}/**"
    servers = [keys.all_servers()]
    return [
        _right("ingress", ["query"], [keys.request(tree, "hello")]),
        _right("ingress", ["liveliness_token"], [keys.clients(tree)]),
        _right("ingress", ["liveliness_query", "declare_liveliness_subscriber"], servers),
        _right("egress", ["liveliness_token"], servers),
        # Publishers and queriers send only where they know of a receiver.
        _right("egress", ["reply", "declare_subscriber", "declare_queryable"], [everything]),
    ]


def _rights(tree: str, rule: AccessRule, *, keyed: bool) -> list[dict[str, Any]]:
    prefix = keys.prefix(tree)
    queries: list[str] = []
    puts: list[str] = []
    rights: list[dict[str, Any]] = []
    if "read" in rule.may:
        queries += (keys.request(tree, name) for name in READS)
        streams = [keys.streams(tree), keys.streams(tree, "*")]
        rights.append(_right("ingress", ["declare_subscriber"], streams))
        rights.append(_right("egress", ["put"], streams))
    for name in ("clear", "reset", "remove_frame"):
        if name in rule.may:
            queries.append(keys.write_request(tree, "admin", name))
    for pattern in rule.publish:
        chunk = access_rules.authority_chunk(pattern)
        queries += (f"{prefix}/{request_type}/{chunk}" for request_type in ("commit", "batch"))
        puts += (f"{prefix}/{kind}/{chunk}" for kind in ("set", "static"))
    if not keyed:
        queries += (keys.request(tree, request_type) for request_type in KEYED)
    if queries:
        rights.append(_right("ingress", ["query"], queries))
    if puts:
        rights.append(_right("ingress", ["put"], puts))
    if "listen" in rule.may:
        heard = [f"{prefix}/{kind}/**" for kind in ("set", "static")]
        rights.append(_right("ingress", ["declare_subscriber"], heard))
        rights.append(_right("egress", ["put"], heard))
    return rights
