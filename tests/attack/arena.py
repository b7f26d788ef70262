"""Where a case is played: a server, how attacks beside other clients are measured, and the bounds
that each measured value must keep."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import zenoh

from tests.support import messages

from .processes import Call, Cost, Probe, Server, attacker, costs, plain_load

#: Bounds of a service that holds.
OUTAGE_MS = 100.0
P99_RATIO = 3.0
SMALL_BYTES, SMALL_MS, SMALL_MB = 10_000, 20.0, 20.0
ANY_MS, ANY_MB = 500.0, 200.0


@dataclass(frozen=True)
class Finding:
    """One measured value. With a bound it must not be above that; without one it informs."""

    name: str
    value: float
    unit: str
    bound: float = math.inf
    note: str = ""

    @property
    def kept(self) -> bool:
        return self.value <= self.bound  # false for NaN: what was not measured is not kept


def outage_ms(calls: Sequence[Call], start_s: float, end_s: float, period_s: float) -> float:
    """The longest time in a window without a call that succeeded, less the probe's period."""
    good = sorted(call.end_s for call in calls if call.outcome == "ok")
    inside = [start_s, *(each for each in good if start_s < each < end_s), end_s]
    return max(0.0, 1e3 * (float(np.diff(inside).max()) - period_s))


def in_window(calls: Sequence[Call], start_s: float, end_s: float) -> list[Call]:
    """The calls that were under way in a window."""
    return [call for call in calls if call.end_s > start_s and call.start_s < end_s]


def p99_ms(calls: Sequence[Call], start_s: float, end_s: float) -> float:
    """The 99th percentile of the durations of the calls in a window, whatever came of them."""
    times = [call.end_s - call.start_s for call in in_window(calls, start_s, end_s)]
    return 1e3 * float(np.percentile(times, 99)) if times else math.nan


def failures(calls: Sequence[Call], start_s: float, end_s: float) -> int:
    return sum(call.outcome != "ok" for call in in_window(calls, start_s, end_s))


Played = TypeVar("Played", bound=Callable[..., list[Finding]])

#: Windows of a measurement beside other clients.
QUIET_S, LOAD_S = 3.0, 6.0
_SETTLE_S = 0.5


@dataclass(frozen=True)
class Arena:
    """How the cases of one run are played."""

    python: str  # the interpreter that runs servers and SDK clients

    @contextlib.contextmanager
    def server(self, *flags: str, endpoint: str | None = None) -> Iterator[Server]:
        with Server(self.python, *flags, endpoint=endpoint) as server:
            yield server

    @contextlib.contextmanager
    def opened(self, *flags: str) -> Iterator[tuple[Server, zenoh.Session]]:
        """A server, and a session with it."""
        with self.server(*flags) as server, messages.session(server.endpoint) as opened:
            yield server, opened


@dataclass(frozen=True)
class Case:
    description: str  # begins with its number
    play: Callable[[Arena], list[Finding]]


#: All cases by their numbers.
CASES: dict[str, Case] = {}


def case(description: str, *arguments: Any, **options: Any) -> Callable[[Played], Played]:
    """Makes a function a case, with these arguments behind the arena."""

    def decorate(function: Played) -> Played:
        CASES[description.partition(":")[0]] = Case(
            description, lambda arena: function(arena, *arguments, **options)
        )
        return function

    return decorate


@dataclass(frozen=True)
class Window:
    start_s: float
    end_s: float

    @classmethod
    @contextlib.contextmanager
    def of(cls, seconds: float) -> Iterator[list[Window]]:
        """Lasts for `seconds` at least, and as long as its block."""
        found: list[Window] = []
        start_s = time.monotonic()
        yield found
        time.sleep(max(0.0, seconds - (time.monotonic() - start_s)))
        found.append(cls(start_s, time.monotonic()))


@dataclass(frozen=True)
class Beside:
    """Calls of each kind of probe, and the windows in which they were made."""

    calls: dict[str, list[Call]]
    periods_s: dict[str, float]
    quiet: Window
    load: Window
    attack: Window

    def outages(self, bound_ms: float = OUTAGE_MS) -> list[Finding]:
        """The longest outage of each kind of call, beyond that beside plain load."""
        found = []
        for kind, calls in self.calls.items():
            period_s = self.periods_s[kind]
            each = [
                outage_ms(calls, window.start_s, window.end_s, period_s)
                for window in (self.quiet, self.load, self.attack)
            ]
            failed = failures(calls, self.attack.start_s, self.attack.end_s)
            note = f"quiet {each[0]:.0f}, plain load {each[1]:.0f}, attack {each[2]:.0f}; "
            note += f"{failed} failed"
            extra = max(0.0, each[2] - each[1])
            found.append(Finding(f"outage of {kind}", extra, "ms", bound_ms, note))
        return found

    def p99(self, kind: str, bound: float = P99_RATIO) -> Finding:
        """The p99 of one kind of call, as a multiple of that beside plain load."""
        each = [
            p99_ms(self.calls[kind], window.start_s, window.end_s)
            for window in (self.quiet, self.load, self.attack)
        ]
        note = f"quiet {each[0]:.1f}, plain load {each[1]:.1f}, attack {each[2]:.1f} ms"
        return Finding(f"p99 of {kind} to plain load", each[2] / each[1], "x", bound, note)

    def ages(self, kind: str = "sensor", window: Window | None = None) -> list[float]:
        """The ages in ms of the newest data during the attack, or another window."""
        window = window or self.attack
        return [
            1e3 * call.age_s
            for call in self.calls[kind]
            if window.start_s < call.end_s < window.end_s
        ]

    def age_ratio(self, percent: float, bound: float, kind: str = "sensor") -> Finding:
        """A percentile of the ages, as a multiple of that beside plain load."""
        windows = (self.quiet, self.load, self.attack)
        each = [float(np.percentile(self.ages(kind, window), percent)) for window in windows]
        note = f"quiet {each[0]:.1f}, plain load {each[1]:.1f}, attack {each[2]:.1f} ms"
        name = f"age of a sensor's data, p{percent:.0f}, to plain load"
        return Finding(name, each[2] / each[1], "x", bound, note)


def beside(
    server: Server,
    kinds: Sequence[str],
    attack: Callable[[], object],
    attack_s: float,
    load: int = 2,
    period_s: float = 0.02,
) -> Beside:
    """Run probes in a quiet window, beside `load` spinning processes, and beside the attack."""
    with contextlib.ExitStack() as stack:
        probes = [stack.enter_context(Probe(server, kind, period_s)) for kind in kinds]
        time.sleep(_SETTLE_S)
        with Window.of(QUIET_S) as quiet:
            pass
        with plain_load(load):
            time.sleep(_SETTLE_S)
            with Window.of(LOAD_S) as loaded:
                pass
        time.sleep(_SETTLE_S)
        with Window.of(attack_s) as attacked:
            attack()
        calls = {probe.kind: probe.calls() for probe in probes}
    periods_s = {probe.kind: probe.period_s for probe in probes}
    return Beside(calls, periods_s, quiet[0], loaded[0], attacked[0])


@contextlib.contextmanager
def attackers(server: Server, *each: Sequence[str]) -> Iterator[Callable[[], None]]:
    """Attackers that are ready; the function lets all of them begin."""
    with contextlib.ExitStack() as stack:
        running = [stack.enter_context(attacker(server.endpoint, *one)) for one in each]

        def begin() -> None:
            for one in running:
                one.go()

        yield begin


def message_cost(
    server: Server,
    opened: zenoh.Session,
    request_type: str,
    payload: bytes,
    timeout_s: float = 120.0,
) -> tuple[list[Finding], bytes]:
    """Findings on what one message costs the server, and the reply to it."""
    with costs(server) as found:
        reply, failed = messages.send(opened, request_type, payload, timeout_s)
    note = f"{len(payload) / 1e3:.1f} kB, reply {len(reply) / 1e6:.1f} MB "
    note += messages.kind_of(reply, failed) if server.running else "the server died"
    return cost_findings(found[0], len(payload), len(reply), note), reply


def cost_findings(cost: Cost, sent: int, replied: int, note: str) -> list[Finding]:
    small = sent < SMALL_BYTES
    reply_mb = replied / (1 << 20)
    return [
        Finding("processor time", cost.cpu_ms, "ms", SMALL_MS if small else ANY_MS, note),
        Finding(
            "memory beyond the reply",
            max(0.0, cost.peak_mb - reply_mb),
            "MB",
            SMALL_MB if small else ANY_MB,
            f"peak {cost.peak_mb:.0f}, stays {cost.left_mb:.0f}, {cost.wall_ms:.0f} ms",
        ),
    ]
