"""The dashboard and the alerts use what the server really exports."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator

from prometheus_client import CollectorRegistry, ProcessCollector
from ruamel.yaml import YAML

from zenoh_tf.introspection import metric_table

from .repository import Repository, Violation

DASHBOARD = "docker/grafana/dashboard.json"
ALERTS = "docker/prometheus/alerts.yaml"
#: Made by Prometheus itself.
OF_PROMETHEUS = {"up"}
NAME = r"\b((?:zenoh_tf|process|python)_\w+|up)\b(?:\{([^}]*)\})?"


def exported() -> dict[str, set[str]]:
    """The sample names of a server's page, with their labels."""
    names: dict[str, set[str]] = {name: set() for name in OF_PROMETHEUS}
    for metric in metric_table.all_metrics():
        labels = set(metric.labels)
        if metric.kind == "histogram":
            names |= {f"{metric.full_name}_{end}": labels for end in ("sum", "count")}
            names[f"{metric.full_name}_bucket"] = labels | {"le"}
        else:
            names[metric.full_name] = labels
    registry = CollectorRegistry()
    ProcessCollector(registry=registry)
    return names | {sample.name: set() for each in registry.collect() for sample in each.samples}


def expressions(repository: Repository) -> Iterator[tuple[str, str, str]]:
    """Every query of the dashboard and of the alerts, with its file and its title."""
    dashboard = json.loads(repository.text(DASHBOARD))
    for panel in dashboard["panels"]:
        for target in panel.get("targets", ()):
            yield DASHBOARD, panel["title"], target["expr"]
    for variable in dashboard["templating"]["list"]:
        if variable["type"] == "query":
            yield DASHBOARD, variable["name"], variable["query"]["query"]
    for group in YAML(typ="safe").load(repository.text(ALERTS))["groups"]:
        for rule in group["rules"]:
            yield ALERTS, rule["alert"], rule["expr"]


def names_in(expression: str) -> list[tuple[str, set[str]]]:
    """The metrics in a query, with the labels that their selectors name."""
    found = re.finditer(NAME, re.sub(r'"[^"]*"', '""', expression))
    return [(each[1], set(re.findall(r"(\w+)\s*[=!]", each[2] or ""))) for each in found]


def queries(repository: Repository) -> Iterator[Violation]:
    """Queries use metrics and labels that are exported."""
    known = exported()
    for path, title, expression in expressions(repository):
        for problem in query_problems(expression, known):
            yield repository.at(path, title, f"{title}: {problem}")


def query_problems(expression: str, known: dict[str, set[str]]) -> Iterator[str]:
    grouped = set(re.findall(r"\w+", " ".join(re.findall(r"\bby \(([^)]*)\)", expression))))
    for name, labels in names_in(expression):
        if name not in known:
            yield f"there is no metric {name}"
        elif missing := labels - known[name] - {"instance", "job"}:
            yield f"{name} has no label {', '.join(missing)}"
        grouped -= known.get(name, set()) | {"instance"}
    if grouped:
        yield f"groups by {', '.join(grouped)}, which is no label"
