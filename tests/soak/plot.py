"""The figure of a soak: memory, files and threads of the server over time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib import pyplot as plt

from bench.figures import BLUE, ORANGE, save

GREY = "#777777"


def draw(samples: list[dict[str, Any]], path: Path) -> None:
    """Draw samples of any number into an SVG file."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4))
    minutes = [each["s"] / 60 for each in samples]
    for field, label, color in (
        ("rss_mb", "server", BLUE),
        ("client_rss_mb", "a client of the whole time", GREY),
    ):
        left.plot(minutes, [each[field] for each in samples], color=color, label=label)
    for field, label, color in (
        ("files", "open files", BLUE),
        ("threads", "threads", ORANGE),
    ):
        right.plot(minutes, [each[field] for each in samples], color=color, label=label)
    left.set_ylabel("resident memory, MB")
    right.set_ylabel("of the server")
    for axes in (left, right):
        axes.set_xlabel("minutes")
        axes.set_ylim(bottom=0)
        axes.grid(color="#dddddd", linewidth=0.6)
        axes.legend(fontsize=8, frameon=False)
    killed = samples[-1]["counts"].get("guests", {}).get("killed", 0)
    frames = samples[-1]["counts"].get("churn", {}).get("ok", 0)
    figure.suptitle(
        f"{frames:,} frames made and removed, {killed:,} clients killed, sensors, statics, "
        "transactions and damaged messages",
        fontsize=10,
    )
    figure.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    save(figure, path)
