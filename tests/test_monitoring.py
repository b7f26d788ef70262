"""The dashboard, the alerts and the compose files use what the server really exports."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from prometheus_client import CollectorRegistry, ProcessCollector
from ruamel.yaml import YAML

from zenoh_tf_server import flags, metric_table

ROOT = Path(__file__).resolve().parent.parent
DOCKER = ROOT / "docker"
#: Made by Prometheus itself.
OF_PROMETHEUS = {"up"}


def load(name: str) -> Any:
    return YAML(typ="safe").load(DOCKER / name)


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
    names |= {sample.name: set() for family in registry.collect() for sample in family.samples}
    return names


def expressions() -> Iterator[tuple[str, str]]:
    """Every query of the dashboard and of the alerts, with its title."""
    dashboard = json.loads((DOCKER / "grafana/dashboard.json").read_text())
    for panel in dashboard["panels"]:
        for target in panel.get("targets", ()):
            yield panel["title"], target["expr"]
    for variable in dashboard["templating"]["list"]:
        if variable["type"] == "query":
            yield variable["name"], variable["query"]["query"]
    for group in load("prometheus/alerts.yaml")["groups"]:
        for rule in group["rules"]:
            yield rule["alert"], rule["expr"]


def names_in(expression: str) -> Iterator[tuple[str, set[str]]]:
    """The metrics in a query, with the labels that their selectors name."""
    without_texts = re.sub(r'"[^"]*"', '""', expression)
    pattern = r"\b((?:zenoh_tf|process|python)_\w+|up)\b(?:\{([^}]*)\})?"
    for found in re.finditer(pattern, without_texts):
        yield found[1], set(re.findall(r"(\w+)\s*[=!]", found[2] or ""))


@pytest.mark.parametrize(("title", "expression"), list(expressions()))
def test_queries_use_existing_metrics_and_labels(title: str, expression: str) -> None:
    known = exported()
    found = list(names_in(expression))
    assert found, f"{title}: {expression} names no metric"
    for name, labels in found:
        assert name in known, f"{title}: no metric {name}"
        assert labels <= known[name] | {"instance", "job"}, f"{title}: {name} has no {labels}"
    grouped = set(re.findall(r"\w+", " ".join(re.findall(r"\bby \(([^)]*)\)", expression))))
    assert grouped <= set.union(*(known[name] for name, _ in found)) | {"instance"}, title
    assert expression.count("(") == expression.count(")")


def test_the_dashboard_shows_most_metrics() -> None:
    used = {name for _, expression in expressions() for name, _ in names_in(expression)}
    metrics = {metric.full_name for metric in metric_table.all_metrics()}
    unused = metrics - {re.sub("_bucket$", "", name) for name in used}
    assert len(unused) < len(metrics) / 4, unused


def test_panels_do_not_overlap_and_have_ids_of_their_own() -> None:
    panels = json.loads((DOCKER / "grafana/dashboard.json").read_text())["panels"]
    assert len({panel["id"] for panel in panels}) == len(panels)
    cells: set[tuple[int, int]] = set()
    for place in (panel["gridPos"] for panel in panels):
        own = {
            (place["x"] + right, place["y"] + down)
            for right in range(place["w"])
            for down in range(place["h"])
        }
        assert not own & cells
        assert max(x for x, _ in own) < 24
        cells |= own


@pytest.mark.parametrize("name", ["compose.yaml", "compose.monitoring.yaml", "compose-ros2.yaml"])
def test_compose_files_are_valid(name: str) -> None:
    check = [sys.executable, "-m", "check_jsonschema"]
    done = subprocess.run(
        [*check, "--builtin-schema", "vendor.compose-spec", DOCKER / name],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    for service, described in load(name)["services"].items():
        if name != "compose.monitoring.yaml" or "image" in described:
            assert described["mem_limit"] and described["pids_limit"], service
            assert "no-new-privileges:true" in described["security_opt"], service


def test_prometheus_scrapes_the_port_that_the_server_listens_on() -> None:
    command = load("compose.monitoring.yaml")["services"]["server"]["command"]
    options = flags.parser().parse_args(command)
    port = options.metrics.rpartition(":")[2]
    (job,) = load("prometheus/prometheus.yaml")["scrape_configs"]
    assert job["static_configs"] == [{"targets": [f"server:{port}"]}]
    assert job["job_name"] in (DOCKER / "prometheus/alerts.yaml").read_text()


def test_mounted_files_exist() -> None:
    for described in load("compose.monitoring.yaml")["services"].values():
        for volume in described.get("volumes", ()):
            source = volume.split(":")[0]
            assert not source.startswith(".") or (DOCKER / source).exists(), source
