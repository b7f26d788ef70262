"""The dashboard, the alerts and the compose files use what the server really exports."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from prometheus_client import CollectorRegistry, ProcessCollector
from ruamel.yaml import YAML

from zenoh_tf.introspection import metric_table
from zenoh_tf_server import flags

from .repository import Repository, Violation

DASHBOARD = "docker/grafana/dashboard.json"
ALERTS = "docker/prometheus/alerts.yaml"
SCRAPE = "docker/prometheus/prometheus.yaml"
MONITORING = "docker/compose.monitoring.yaml"
COMPOSE = ("docker/compose.yaml", MONITORING, "docker/compose-ros2.yaml")
#: Made by Prometheus itself.
OF_PROMETHEUS = {"up"}
NAME = r"\b((?:zenoh_tf|process|python)_\w+|up)\b(?:\{([^}]*)\})?"
#: Columns of the dashboard's grid.
GRID_WIDTH = 24


def load(repository: Repository, path: str) -> Any:
    return YAML(typ="safe").load(repository.text(path))


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
    for group in load(repository, ALERTS)["groups"]:
        for rule in group["rules"]:
            yield ALERTS, rule["alert"], rule["expr"]


def names_in(expression: str) -> list[tuple[str, set[str]]]:
    """The metrics in a query, with the labels that their selectors name."""
    found = re.finditer(NAME, re.sub(r'"[^"]*"', '""', expression))
    return [(each[1], set(re.findall(r"(\w+)\s*[=!]", each[2] or ""))) for each in found]


def queries(repository: Repository) -> Iterator[Violation]:
    """Queries use metrics and labels that are exported, and the dashboard shows most metrics."""
    known, used = exported(), set()
    for path, title, expression in expressions(repository):
        names = names_in(expression)
        used |= {re.sub("_bucket$", "", name) for name, _ in names}
        for problem in query_problems(expression, names, known):
            yield repository.at(path, title, f"{title}: {problem}")
    metrics = {metric.full_name for metric in metric_table.all_metrics()}
    if len(metrics - used) > len(metrics) / 4:
        problem = f"show more metrics than these: {', '.join(sorted(metrics - used))}"
        yield Violation(DASHBOARD, 1, problem)


def query_problems(
    expression: str, names: list[tuple[str, set[str]]], known: dict[str, set[str]]
) -> Iterator[str]:
    if not names:
        yield f"{expression} names no metric"
    if expression.count("(") != expression.count(")"):
        yield f"{expression} has an open parenthesis"
    for name, labels in names:
        if name not in known:
            yield f"there is no metric {name}"
        elif missing := labels - known[name] - {"instance", "job"}:
            yield f"{name} has no label {', '.join(missing)}"
    grouped = set(re.findall(r"\w+", " ".join(re.findall(r"\bby \(([^)]*)\)", expression))))
    labels = set().union(*(known.get(name, set()) for name, _ in names)) | {"instance"}
    if grouped - labels:
        yield f"groups by {', '.join(grouped - labels)}, which is no label"


def panels(repository: Repository) -> Iterator[Violation]:
    """Panels do not overlap, stay in the grid, and have ids of their own."""
    cells: dict[tuple[int, int], str] = {}
    ids: set[int] = set()
    for panel in json.loads(repository.text(DASHBOARD))["panels"]:
        place, title = panel["gridPos"], panel.get("title", "a panel")
        if panel["id"] in ids:
            yield repository.at(DASHBOARD, title, f"{title}: id {panel['id']} is taken")
        ids.add(panel["id"])
        for x in range(place["x"], place["x"] + place["w"]):
            for y in range(place["y"], place["y"] + place["h"]):
                other = cells.setdefault((x, y), title) if x < GRID_WIDTH else "the border"
                if other != title:
                    yield repository.at(DASHBOARD, title, f"{title} overlaps {other}")


def compose_files(repository: Repository) -> Iterator[Violation]:
    """Compose files are valid, limit their containers, and mount files that exist."""
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder, path.replace("/", "-")) for path in COMPOSE]
        for path, file in zip(COMPOSE, files, strict=True):
            file.write_text(repository.text(path))
        schema = ("--builtin-schema", "vendor.compose-spec")
        done = subprocess.run(
            [sys.executable, "-m", "check_jsonschema", *schema, *files],
            capture_output=True,
            text=True,
            check=False,
        )
    if done.returncode:
        report = " ".join(done.stdout.split())
        yield Violation(COMPOSE[0].rpartition("/")[0], 1, report)
        return
    for path in COMPOSE:
        for name, service in load(repository, path)["services"].items():
            limits = service.get("mem_limit") and service.get("pids_limit")
            safe = "no-new-privileges:true" in service.get("security_opt", ())
            if (path != MONITORING or "image" in service) and not (limits and safe):
                problem = f"{name}: set mem_limit, pids_limit and no-new-privileges:true"
                yield repository.at(path, f"{name}:", problem)
            for volume in service.get("volumes", ()):
                source = volume.split(":")[0]
                if source.startswith("./") and not repository.exists(f"docker/{source[2:]}"):
                    is_made = "certificates" in source  # by the command in the file's head
                    if not is_made:
                        yield repository.at(path, volume, f"mounts {source}, which is missing")


def scraping(repository: Repository) -> Iterator[Violation]:
    """Prometheus scrapes the port that the server listens on, under the alerts' job name."""
    command = load(repository, MONITORING)["services"]["server"]["command"]
    _, port = flags.parser().parse_args(command).metrics
    (job,) = load(repository, SCRAPE)["scrape_configs"]
    if job["static_configs"] != [{"targets": [f"server:{port}"]}]:
        yield repository.at(SCRAPE, "targets", f"the server's metrics are at server:{port}")
    if job["job_name"] not in repository.text(ALERTS):
        yield repository.at(SCRAPE, "job_name", "no alert is about this job")
