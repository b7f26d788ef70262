"""The documentation's measured numbers, from the kept results; ``make lint`` compares them.

In a page, ``<!-- bench:KEY -->20.6<!-- / -->`` holds the number KEY; readers see only 20.6. A
marker must not begin a line, unless the line has nothing else.
"""

from __future__ import annotations

import re

from bench.machine import ROOT
from bench.results import Results

MARKER = re.compile(r"(<!-- bench:(?P<key>\S+) -->)(?P<text>.*?)(<!-- / -->)", re.DOTALL)
PAGES = ("README.md", "bench/README.md", "docs/**/*.md")
IDS, NAMES = "latest common, ids", "latest common, names"
AT = "lookup_transform(TARGET, SOURCE, next(times))"
MIRRORS = {"full": "full", "pair": "interest", "pair-now": "interest at once", "thin": "thinned"}
ROBOTS = "10 robots of 60 frames at 100 Hz"


def numbers(results: Results) -> dict[str, str]:
    """The text of each key."""
    found: dict[str, str] = {}
    for add in (_about, _core, _python, _sensors, _mirrors, _host):
        found |= add(results)
    return found


def _about(results: Results) -> dict[str, str]:
    files, targets = list(results.parts.values()), results.targets()
    about, missed = files[0]["machine"], [target for target in targets if not target["reached"]]
    lines = ["\n", "| part | target | wanted | measured |", "|---|---|---|---|"]
    for target in missed:
        wanted = target["wanted"].replace("<", "&lt;")
        lines.append(
            f"| `{target['part']}` | {target['name']} | {wanted} | {_range(target['found'])} |"
        )
    load, others = (max(file[key] for file in files) for key in ("load", "background_cores"))
    return {
        "machine": f"{about['cores']} cores of an {about['cpu']}",
        "conditions": f"commit {files[0]['commit'][:12]}, {files[0]['date']}; the load was {load:g}"
        f" at the start, and other programs used at most {others:g} cores during a part",
        "minutes": f"{sum(file['seconds'] for file in files) / 60:.0f}",
        "targets": str(len(targets)),
        "missed": str(len(missed)),
        "missed-table": "\n".join([*lines, "\n"]),
    }


def _core(results: Results) -> dict[str, str]:
    found = {}
    for row in results.rows("lookups", case=IDS):
        found[f"ids-{row['threads']}-{row['system']}"] = _digits(row["reads_per_s"][1] / 1e6)
    for row in results.rows("lookups", case=NAMES):
        rates = [rate / 1e6 for rate in row["reads_per_s"]]
        found[f"names-{row['threads']}-{row['system']}"] = _range(rates)
    for part, size in (("paper-cached", "1k"), ("paper", "1m")):
        for row in results.rows(part, direction="opposite", readers=1, writers=1):
            key = f"{size}-{row['system']}-{row['read'].removeprefix('latest-')}"
            found[f"{key}-reads"] = _digits(row["reads_per_s"][1] / 1e6)
            found[f"{key}-writes"] = _digits(row["links_written_per_s"][1] / 1e6)
    return found


def _python(results: Results) -> dict[str, str]:
    cases = {"latest common time": "latest", "at a time": "at", "latest, atomic": "xact"}
    found = {"row-us": _digits(1e6 / results.median("rows", "rows_per_s"))}
    for row in results.rows("embedded", case=AT):
        found[f"embedded-at-{row['system']}"] = _digits(row["us_per_call"][1])
    for row in results.rows("reads"):
        key = f"{cases[row['case']]}-{row['system'].replace(' ', '-')}"
        found[key] = _digits(row["us_per_call"][1])
    for case, key in cases.items():
        target = results.targets("reads", f"{case}, mirror to embedded")[0]
        found[f"{key}-mirror-to-embedded"] = f"{target['found'][1]:.2f}"
    memory = [row["mb"][1] for row in results.rows("async") if "mb" in row]
    return found | {"async-mb": _span(memory)}


def _sensors(results: Results) -> dict[str, str]:
    found = {}
    for stamps in (100_000, 1024):
        labels = {"system": "deskew", "stamps": stamps, "moving links": 1}
        rate = results.median("sensors", "points_per_s", **labels)
        found[f"deskew-{stamps}-ms"] = _digits(1e3 * 100_000 / rate)
    for key, name in (("loop", "a loop of lookups"), ("numpy", "NumPy")):
        targets = [t for t in results.targets("sensors") if t["name"].endswith(f" to {name}")]
        found[f"deskew-{key}"] = _span([target["found"][1] for target in targets])
    rates = {
        (row["type"], row["system"]): row["points_per_s"][1]
        for row in results.rows("sensors")
        if row["type"]
    }
    kinds = ("float32", "float64")
    copies = [rates[kind, "np.copyto"] / rates[kind, "apply"] for kind in kinds]
    return found | {"apply-to-copy": _span(copies)}


def _mirrors(results: Results) -> dict[str, str]:
    found: dict[str, str] = {}
    none = results.median("mirrors", "server_share", case=ROBOTS, system="none")
    for key, kind in MIRRORS.items():
        row = _medians(results, "mirrors", case=ROBOTS, system=kind)
        found |= {
            f"mirror-{key}-server": f"{max(0.0, row['server_share'] - none):.2f}",
            f"mirror-{key}-client": f"{row['client_share']:.2f}",
            f"mirror-{key}-network": _bytes(row["bytes_per_s"]),
            f"mirror-{key}-messages": _digits(row["messages_per_s"]),
            f"mirror-{key}-age": _digits(row["age_ms"]),
        }
        if kind == "full":
            found["mirror-row-bytes"] = _digits(row["bytes_per_s"] / row["transforms_per_s"])
            us = 1e6 * row["client_share"] / row["transforms_per_s"]
            found["mirror-row-us"] = _digits(us)
    for count in (30, 100):
        row = _medians(results, "mirrors", case=f"one mirror of everything, {count} robots")
        found |= {
            f"mirror-{count}-stored": _digits(row["transforms_per_s"]),
            f"mirror-{count}-dropped": _digits(row["dropped_puts_per_s"]),
            f"mirror-{count}-age": _digits(row["age_ms"]),
            f"mirror-{count}-tail": _digits(row["age_p99_ms"]),
            f"mirror-{count}-pose": _digits(row["pose_age_ms"]),
            f"mirror-{count}-gaps": _digits(row["stream_gaps"]),
        }
    return found


def _host(results: Results) -> dict[str, str]:
    """What a server needs of its host."""
    one, ten, client, waiting, single = (
        _medians(results, "sizing", case=case)
        for case in (
            *("1 robots", "10 robots", "a connected client"),
            *("a waiting lookup", "a single lookup"),
        )
    )
    found = {
        "server-mb": _digits(one["empty_mb"]),
        "robots-1-mb": _digits(one["mb"]),
        "robots-1-core": _digits(one["core_percent"]),
        "robots-10-mb": _digits(ten["mb"]),
        "robots-10-core": _digits(ten["core_percent"]),
        "sample-bytes": _digits(ten["bytes_per_sample"]),
        "client-mb": _digits(client["mb"]),
        "client-core": _digits(client["core_percent"]),
        "waiting-kb": _digits(waiting["kb"]),
        "lookup-ms": _digits(single["us_of_processor"] / 1000),
    }
    for row in results.rows("readers"):
        if row["system"] != "a tree of its own":
            found[f"readers-{row['reader processes']}-server"] = f"{row['server_cores'][1]:.2f}"
    for target in results.targets("readers"):
        found[f"readers-{target['name'].split()[0]}"] = f"{target['found'][1]:.2f}"
    return found


def _medians(results: Results, part: str, **labels: object) -> dict[str, float]:
    """The medians of all metrics of the only row with these labels."""
    (row,) = results.rows(part, **labels)
    return {name: found[1] for name, found in row.items() if isinstance(found, list)}


def _digits(value: float) -> str:
    """Two significant digits, three from 10 on; no exponent."""
    return f"{float(f'{value:.3g}' if value >= 10 else f'{value:.2g}'):,.10g}"


def _range(values: list[float]) -> str:
    low, median, high = (f"{value:.3g}" for value in values)
    return f"{median} ({low} to {high})"


def _span(values: list[float]) -> str:
    low, high = _digits(min(values)), _digits(max(values))
    return low if low == high else f"{low} to {high}"


def _bytes(value: float) -> str:
    return f"{_digits(value / 1e6)} MB" if value >= 1e6 else f"{_digits(value / 1e3)} kB"


def filled(text: str, found: dict[str, str]) -> str:
    """The text with each number as measured. An unknown key raises KeyError."""
    return MARKER.sub(lambda match: f"{match[1]}{found[match['key']]}{match[4]}", text)


def rewrite(results: Results) -> None:
    """Writes the numbers of the results into the pages."""
    found = numbers(results)
    for path in (path for pattern in PAGES for path in sorted(ROOT.glob(pattern))):
        try:
            path.write_text(filled(path.read_text(), found))
        except KeyError as key:
            raise SystemExit(f"{path.relative_to(ROOT)}: no result has the key {key}") from None
