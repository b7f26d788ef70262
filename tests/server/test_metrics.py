"""The port for Prometheus and health checks, of real servers."""

from __future__ import annotations

import argparse
import contextlib
import re
import socket
import struct
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from pathlib import Path

import pytest
from prometheus_client.parser import text_string_to_metric_families

from tests.conftest import StartServer
from tests.processes import forks
from tests.processes.ports import free_endpoint, free_port
from tests.processes.servers import ServerProcess, refused
from tests.support.raw import raw
from tests.support.waiting import wait_until
from zenoh_tf import StampedTransform, Transform, wire
from zenoh_tf.errors import LookupException
from zenoh_tf.introspection import metric_table
from zenoh_tf.text.flag_values import host_and_port
from zenoh_tf_server.monitoring.status_port import Page, StatusPort
from zenoh_tf_server.requests.counters import RequestCounters, buckets

HOSTILE = 'lidar"\n\x1b[31m\\{}'

Samples = dict[tuple[str, frozenset[tuple[str, str]]], float]


def metrics_url(server: ServerProcess) -> str:
    found = wait_until(lambda: re.search(r"metrics on port (\d+)", server.log))
    return f"http://127.0.0.1:{found[1]}"  # type: ignore[index]


def fetch(url: str) -> tuple[int, str]:
    try:
        with urllib.request.urlopen(url, timeout=20) as reply:
            return reply.status, reply.read().decode()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read().decode()


def scrape(server: ServerProcess) -> Samples:
    status, text = fetch(f"{metrics_url(server)}/metrics")
    assert status == 200
    assert text.replace("\n", "").isprintable()
    samples: Samples = {}
    for family in text_string_to_metric_families(text):
        assert family.documentation
        for sample in family.samples:
            key = (sample.name, frozenset(sample.labels.items()))
            assert key not in samples, f"{key} twice"
            samples[key] = sample.value
    return samples


def until(server: ServerProcess, condition: Callable[[Samples], bool]) -> Samples:
    """Scrape until the condition holds: a page is up to a second old."""
    return wait_until(lambda: samples if condition(samples := scrape(server)) else {})


def value(samples: Samples, name: str, **labels: str) -> float:
    return samples.get((f"zenoh_tf_{name}", frozenset(labels.items())), 0.0)


def link(child: str, stamp_ns: int = 1) -> StampedTransform:
    return StampedTransform("map", child, stamp_ns, Transform())


@pytest.fixture
def server(start_server: StartServer, tmp_path: Path) -> ServerProcess:
    flags = ["--metrics", "127.0.0.1:0"]
    flags += ["--state-dir", str(tmp_path / "state"), "--ros2", "--ros2-publish"]
    return start_server(*flags)


def test_the_values_are_those_of_the_server(server: ServerProcess) -> None:
    with server.connect() as tf:
        tf.set_transform(link("base"))
        for _ in range(20):
            tf.lookup_transform("map", "base")
        with pytest.raises(LookupException):
            tf.parent("nowhere")
        samples = until(server, lambda found: value(found, "frames") == 2)
        assert value(samples, "connected_clients") == 1
    assert value(samples, "commits_total") == 1
    assert value(samples, "samples") == 1
    assert value(samples, "requests_total", request_type="lookup", outcome="ok") >= 20
    assert value(samples, "requests_total", request_type="commit", outcome="ok") == 1
    assert value(samples, "requests_total", request_type="info", outcome="LookupException") == 1
    duration = "request_duration_seconds"
    count = value(samples, f"{duration}_count", request_type="lookup", outcome="ok")
    assert count == value(
        samples, f"{duration}_bucket", request_type="lookup", outcome="ok", le="+Inf"
    )
    assert count == value(samples, "requests_total", request_type="lookup", outcome="ok")
    assert 0 < value(samples, f"{duration}_sum", request_type="lookup", outcome="ok") < 20 * 60
    assert value(samples, f"{duration}_count", request_type="info", outcome="error") == 1
    assert value(samples, "limit", limit="metrics_authorities") == 100
    assert samples["process_resident_memory_bytes", frozenset()] > 1e6
    (build,) = (dict(labels) for name, labels in samples if name == "zenoh_tf_build_info")
    assert build["tree"] == "main" and build["python"] == ".".join(map(str, sys.version_info[:3]))


def test_authorities_are_bounded_and_their_names_are_safe(server: ServerProcess) -> None:
    names = [HOSTILE, "lidar", *map(str, range(100)), HOSTILE.replace("{", "(")]
    with server.connect() as tf:
        for number, name in enumerate(names):
            tf.set_transform(link(f"f{number}"), authority=name)
        found = until(server, lambda found: value(found, "commits_total") == len(names))
        labels = {dict(labels).get("authority") for _, labels in found} - {None}
        assert len(labels) == 100
        assert all(label is not None and label.isprintable() for label in labels)
        stored = "authority_transforms_stored_total"
        total = sum(number for (name, _), number in found.items() if name == f"zenoh_tf_{stored}")
        assert total == len(labels)


def test_refused_puts_are_counted_by_authority(server: ServerProcess) -> None:
    with raw(server.endpoint) as wires, server.connect():
        wires.put("broken", {"v": 1, "names": "x"})
        samples = until(server, lambda found: value(found, "puts_refused_total") == 1)
    assert value(samples, "authority_transforms_refused_total", authority="broken") == 1


def test_every_value_of_the_server_is_declared(server: ServerProcess) -> None:
    """A key of `stats` that nobody has declared in metric_table fails here."""
    with server.connect() as tf:
        tf.set_transform(link("base"), authority="a")
        stats = {name for name in tf.stats() if not name.startswith("reads_")}  # the client's own
    declared = {name for name in metric_table.FROM_STATS if not name.startswith("replica_")}
    assert stats == declared
    with raw(server.endpoint) as wires:
        reply = wires.query("info", wire.call_body("authorities"))
    (record,) = reply["value"]
    no_metrics = {"name", "last_refusal", "refused_by_reason"}
    assert record.keys() == metric_table.FROM_AUTHORITIES.keys() | no_metrics


def test_every_declared_metric_is_exported_and_no_other(server: ServerProcess) -> None:
    with server.connect() as tf:
        tf.broadcaster("a").send(link("base", time.time_ns()))  # a put, which has an arrival
        # A put is committed first, and then counted for the authority's clock.
        stamp_age = "zenoh_tf_authority_stamp_age_seconds"
        names = {name for name, _ in until(server, lambda found: stamp_age in dict(found.keys()))}
    plain = {re.sub(r"_(bucket|sum|count)$", "", name) for name in names}
    assert {name for name in plain if name.startswith("zenoh_tf_")} == {
        metric.full_name
        for metric in metric_table.all_metrics()
        if not metric.name.startswith(("replica_", "robot_"))
    }


def test_names_follow_the_conventions_of_prometheus() -> None:
    for metric in metric_table.all_metrics():
        assert re.fullmatch(r"zenoh_tf(_[a-z][a-z0-9]*)+", metric.full_name)
        assert (metric.kind == "counter") == metric.name.endswith("_total")
        assert metric.meaning and not metric.meaning.endswith(".")
        if metric.kind == "histogram":
            assert re.search(r"_(seconds|bytes|ratio)(_total)?$", metric.name)


def test_health_and_readiness(server: ServerProcess) -> None:
    url = metrics_url(server)
    assert fetch(f"{url}/healthz") == (200, "ok\n")
    assert fetch(f"{url}/readyz") == (200, "ready\n")
    assert fetch(f"{url}/readyz?verbose=1")[0] == 200
    assert fetch(f"{url}/")[0] == 404
    samples = until(server, lambda found: value(found, "probe_duration_seconds") > 0)
    assert value(samples, "healthy") == value(samples, "ready") == 1


def test_a_server_that_waits_for_its_network_is_not_ready(start_server: StartServer) -> None:
    port = free_port()
    where = ["--connect", free_endpoint(), "--metrics", f"127.0.0.1:{port}"]
    process = forks.Popen(
        [sys.executable, "-m", "zenoh_tf_server", *where],
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
    )
    try:
        deadline = time.monotonic() + 50
        while True:
            try:
                answer = fetch(f"http://127.0.0.1:{port}/readyz")
                break
            except OSError:
                assert time.monotonic() < deadline
                time.sleep(0.05)
        assert answer == (503, "not ready: the tree is not served\n")
        assert "zenoh_tf_ready 0.0" in fetch(f"http://127.0.0.1:{port}/metrics")[1]
    finally:
        process.kill()
        process.communicate(timeout=10)


def test_nothing_listens_without_the_flag(start_server: StartServer) -> None:
    server = start_server()
    server.stop()
    assert "metrics" not in server.log


def test_a_port_in_use_is_said_in_a_line(server: ServerProcess) -> None:
    port = metrics_url(server).rpartition(":")[2]
    line = refused("--listen", free_endpoint(), "--metrics", f"127.0.0.1:{port}")
    assert line == (
        f"zenoh-tf-server: cannot serve metrics on 127.0.0.1:{port}: Address already in use"
    )
    assert "--metrics" in refused("--metrics", "nonsense")


def test_a_missing_prometheus_client_is_said_in_a_line(tmp_path: Path) -> None:
    (tmp_path / "prometheus_client.py").write_text("raise ImportError('not here')\n")
    assert refused("--metrics", "127.0.0.1:0", PYTHONPATH=str(tmp_path)) == (
        "zenoh-tf-server: --metrics needs prometheus-client: "
        "pip install 'zenoh-tf[metrics]', or in a checkout: pip install '.[metrics]'"
    )


@pytest.mark.slow
def test_silent_connections_do_not_use_up_the_server(server: ServerProcess) -> None:
    """Connections that ask nothing are closed, and their number is bounded."""
    host, port = host_and_port(metrics_url(server).removeprefix("http://"))
    before = value(scrape(server), "threads")
    silent = [socket.create_connection((host, port), timeout=20) for _ in range(60)]
    try:
        with server.connect() as tf:
            tf.set_transform(link("base"))
        closed = 0
        for connection in silent:
            closed += connection.recv(1) == b""
        assert closed == len(silent)
    finally:
        for connection in silent:
            connection.close()
    after = value(until(server, lambda found: value(found, "frames") == 2), "threads")
    assert after - before < len(silent)  # Zenoh's own threads come and go with the load


@pytest.mark.parametrize("path", ["/healthz", "/metrics"])
def test_connections_that_drip_do_not_take_all(server: ServerProcess, path: str) -> None:
    """Each sends a byte now and then, so none is silent."""
    url = metrics_url(server)
    where = host_and_port(url.removeprefix("http://"))
    with contextlib.ExitStack() as stack:
        slow = [stack.enter_context(socket.create_connection(where)) for _ in range(40)]
        for connection in slow:
            connection.sendall(b"GET /healthz HTTP/1.1\r\nX: ")
        for _ in range(2):
            for connection in slow:
                with contextlib.suppress(OSError):  # it was ended
                    connection.sendall(b"a")
            assert fetch(f"{url}{path}")[0] == 200


def test_every_address_of_the_host_is_listened_on(monkeypatch: pytest.MonkeyPatch) -> None:
    addresses = [(socket.AF_INET, "127.0.0.1"), (socket.AF_INET, "127.0.0.2")]
    with contextlib.suppress(OSError), socket.socket(socket.AF_INET6) as probe:
        probe.bind(("::1", 0))
        addresses.append((socket.AF_INET6, "::1"))
    missing = (socket.AF_INET, "192.0.2.1")  # no address of this host
    monkeypatch.setattr(
        socket,
        "getaddrinfo",
        lambda _host, port, **_: [
            (family, socket.SOCK_STREAM, 6, "", (address, port))
            for family, address in (*addresses, missing)
        ],
    )
    status = StatusPort(("robot", 0), {"/healthz": lambda: Page(200, b"ok")})
    for family, address in addresses:
        with socket.socket(family) as connection:
            connection.connect((address, status.port))
            connection.sendall(b"GET /healthz HTTP/1.0\r\n\r\n")
            assert connection.recv(100).startswith(b"HTTP/1.0 200")


@pytest.mark.parametrize("text", ["127.0.0.1:9464", "localhost:1", "[::1]:9464"])
def test_addresses(text: str) -> None:
    host, port = host_and_port(text)
    assert "[" not in host and port > 0


@pytest.mark.parametrize("text", ["", "9464", ":9464", "h:", "h:x", "h:70000", "h:-1", "h:٣"])
def test_wrong_addresses(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match=r"is not HOST:PORT"):
        host_and_port(text)


def end(counters: RequestCounters, begun_ns: int) -> None:
    counters.begin(begun_ns).end("lookup")


def serve(counters: RequestCounters, begun_ns: int) -> None:
    counters.served("lookup", begun_ns)


@pytest.mark.parametrize("count", [end, serve])
def test_durations_fall_into_the_right_bucket(
    count: Callable[[RequestCounters, int], None],
) -> None:
    counters = RequestCounters()
    for duration_s in (0.0, 0.02, 0.3, 20.0):
        count(counters, time.perf_counter_ns() - round(duration_s * 1e9))
    pairs, sum_s = buckets(counters.total().ok["lookup"])
    by_bound = dict(pairs)
    assert (by_bound["0.01"], by_bound["0.25"], by_bound["10.0"], by_bound["+Inf"]) == (1, 2, 3, 4)
    assert sum_s >= 20.32


def test_threads_that_end_keep_their_counts_but_no_table() -> None:
    counters = RequestCounters()

    def serve() -> None:
        counts = counters.begin(time.perf_counter_ns())
        counters.failed("ServerBusy")
        counts.end("lookup")

    for _ in range(20):
        thread = threading.Thread(target=serve)
        thread.start()
        thread.join()
    assert counters.total().failures == {("lookup", "ServerBusy"): 20}
    assert len(counters._running) == 0


def test_puts_are_counted_with_their_transforms(server: ServerProcess) -> None:
    body = {
        "v": 1,
        "names": ["map", "base"],
        "parent": struct.pack("<2I", 0, 0),
        "child": struct.pack("<2I", 1, 1),
        "stamp": struct.pack("<2q", 1, 2),
        "pose": struct.pack("<14d", *[0.0, 0, 0, 0, 0, 0, 1] * 2),
    }
    with raw(server.endpoint) as wires, server.connect():
        wires.put("lidar", body)
        samples = until(server, lambda found: value(found, "puts_total") == 1)
    assert value(samples, "put_transforms_total") == 2
