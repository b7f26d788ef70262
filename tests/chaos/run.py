"""A run of chaos: clients that run transactions, and faults of everything that they depend on.

All is drawn from one seed: what the clients do, which faults happen, and when. The seed repeats the
plan; how threads and processes interleave is up to the machine.
"""

from __future__ import annotations

import contextlib
import itertools
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

from tests.attack.processes import ROOT, Process
from tests.processes.ports import free_endpoint
from tests.processes.tcp_proxy import TcpProxy
from zenoh_tf import StampedTransform, Transform, TransformException
from zenoh_tf_client import TransformClient

from . import links
from .client import TIMEOUT_S
from .merge import Merged, Start, merge

_READY_TIMEOUT_S = 100.0
#: Longer than any pause that a fault makes.
_STALLED_S = 60.0
#: How long faults last: some shorter than the clients' time-out, some longer.
_SHORTEST_S, _LONGEST_S = 0.1, 4 * TIMEOUT_S
#: A server keeps samples for ever, so that each version stays decodable and none is too old.
_FLAGS = ("--cache-time", "1e9s", "--log-level", "warning")
_YEAR_NS = 365 * 86_400 * 10**9


#: How transactions read.
READ_KINDS = ("query", "shared", "mirror", "follower", "replica")


class Slot:
    """A client process with a connection of its own through a proxy, replaced if it is killed."""

    def __init__(
        self, number: int, kind: str, proxy: TcpProxy, path: Path, others: Sequence[str] = ()
    ) -> None:
        """`others`: endpoints beside the proxy's."""
        self.proxy = proxy
        self.has_others = bool(others)
        self._endpoints = ",".join([proxy.endpoint, *others])
        self.path = path
        self._number = number
        self._kind = kind
        self._lives = 0
        self._read_bytes = self._answered = 0
        path.touch()
        self.process: subprocess.Popen[bytes] | None = None

    def answered(self) -> int:
        """The transactions that were committed or were in conflict, so far."""
        with self.path.open("rb") as file:
            file.seek(self._read_bytes)
            lines, end, _ = file.read().rpartition(b"\n")
        self._read_bytes += len(lines) + len(end)
        self._answered += lines.count(b'"outcome": "co')
        return self._answered

    def start(self, start_s: float, seed: int, direct: str) -> None:
        self._lives += 1
        arguments = [self._number, start_s, f"{seed} {self._number} {self._lives}", self.path]
        module = "repeater" if self._kind == "repeater" else "client"
        command = [sys.executable, "-m", f"tests.chaos.{module}", self._endpoints]
        command += map(str, arguments)
        command += [direct if self._kind == "repeater" else self._kind]
        self.process = subprocess.Popen(command, cwd=ROOT)

    def signal(self, number: signal.Signals) -> None:
        if self.process is not None and self.process.poll() is None:
            self.process.send_signal(number)

    def kill(self) -> None:
        if self.process is not None:
            self.process.kill()
            self.process.wait()


class Chaos:
    """Runs clients and faults; see the module."""

    def __init__(
        self,
        folder: Path,
        seed: int,
        command: Sequence[str],
        clients: int,
        under: Sequence[str] = (),
    ) -> None:
        """`command` starts the server. `under`: only these faults, by their methods."""
        self._folder = folder
        self._seed = seed
        self._command = command
        self._random = random.Random(seed)
        self._endpoint = free_endpoint()
        self._clients = clients
        self._server: Process | None = None
        self._replica: Process | None = None
        self._replica_endpoint = free_endpoint()
        self._upstream: TcpProxy | None = None  # between the replica and the server
        self._starts: list[Start] = []
        self._slots: list[Slot] = []
        self._start_s = time.monotonic()
        self.faults: Counter[str] = Counter()
        self.log = folder / "server.log"
        kinds: tuple[tuple[Callable[[], None], int], ...] = (
            (self._kill_server, 3),
            (self._stop_server, 3),
            (self._hold_network, 6),
            (self._cut_network, 2),
            (self._reset_network, 2),
            (self._delay_network, 2),
            (self._throttle_network, 1),
            (self._freeze_client, 2),
            (self._kill_client, 2),
            (self._second_server, 1),
            (self._kill_replica, 1),
            (self._stop_replica, 1),
            (self._delay_replica, 1),
            (self._wrong_clock, 1),
            (self._greedy_client, 1),
        )
        self._kinds = [kind for kind in kinds if not under or kind[0].__name__ in under]

    def run(self, transactions: int, pause_s: float = 1.0) -> Merged:
        """Run so many transactions at least, and each kind of fault, and return the history."""
        readers = itertools.islice(itertools.cycle(READ_KINDS), self._clients - 2)
        kinds = [*readers, "blind", "repeater"]
        with contextlib.ExitStack() as stack:
            stack.callback(self._end)
            self._start_server()
            self._upstream = stack.enter_context(TcpProxy(self._endpoint))
            self._start_replica()
            for number, kind in enumerate(kinds):
                proxy = stack.enter_context(TcpProxy(self._endpoint))
                path = self._folder / f"client-{number}.jsonl"
                others = [self._replica_endpoint] if kind == "replica" else []
                self._slots.append(Slot(number, kind, proxy, path, others))
            for slot in self._slots:
                slot.start(self._start_s, self._seed, self._endpoint)
            self._play(transactions, pause_s)
        return merge([slot.path for slot in self._slots], self._starts)

    def _play(self, transactions: int, pause_s: float) -> None:
        # Each kind once at first, in any order, so that a short run has all of them.
        plan = [kind for kind, _ in self._kinds]
        self._random.shuffle(plan)
        kinds, weights = zip(*self._kinds, strict=True)
        answered, changed_s = 0, time.monotonic()
        while plan or answered < transactions:
            time.sleep(self._random.uniform(0.2, 1.8) * pause_s)
            fault = plan.pop() if plan else self._random.choices(kinds, weights)[0]
            fault()
            self.faults[fault.__name__.strip("_").replace("_", " ")] += 1
            now = sum(slot.answered() for slot in self._slots)
            if now > answered:
                answered, changed_s = now, time.monotonic()
            assert time.monotonic() - changed_s < _STALLED_S, "no transaction is answered any more"

    def _end(self) -> None:
        for slot in self._slots:
            slot.kill()
        for server in (self._replica, self._server):
            if server is not None:
                server.end()

    # --- servers

    def _start_server(self) -> None:
        """Start a server and make its tree; both may need several tries while there are faults."""
        with self.log.open("a") as log:
            command = [*self._command, "--listen", self._endpoint, *_FLAGS]
            self._server = Process(command, log)
        epoch = len(self._starts) + 1
        invoked_ns = time.monotonic_ns()
        with TransformClient.connect(
            self._endpoint, timeout_s=_READY_TIMEOUT_S, reads="query"
        ) as tf:
            tf.set_transforms_xact(links.first_rows(epoch))
        self._starts.append(Start(epoch, invoked_ns, time.monotonic_ns()))

    def _start_replica(self) -> None:
        with self.log.open("a") as log:
            command = [*self._command, "--listen", self._replica_endpoint]
            assert self._upstream is not None
            command += ["--replica-of", self._upstream.endpoint, "--log-level", "warning"]
            self._replica = Process(command, log)

    def _lasting_s(self) -> float:
        return self._random.uniform(_SHORTEST_S, _LONGEST_S)

    def _one(self) -> Slot:
        return self._random.choice(self._slots)

    def _kill_server(self) -> None:
        assert self._server is not None
        assert self._server.running, f"the server died:\n{self.log.read_text()[-3000:]}"
        self._server.end()
        self._start_server()

    def _stop_server(self) -> None:
        assert self._server is not None
        self._server.signal(signal.SIGSTOP)
        time.sleep(self._lasting_s())
        self._server.signal(signal.SIGCONT)

    def _second_server(self) -> None:
        """It must find that the tree is taken, and end."""
        command = [*self._command, "--connect", self._endpoint]
        done = subprocess.run(command, capture_output=True, timeout=150, check=False)
        assert done.returncode == 2, f"a second server ended with {done.returncode}"

    def _kill_replica(self) -> None:
        assert self._replica is not None
        assert self._replica.running, f"the replica died:\n{self.log.read_text()[-3000:]}"
        self._replica.end()
        self._start_replica()

    def _stop_replica(self) -> None:
        assert self._replica is not None
        self._replica.signal(signal.SIGSTOP)
        time.sleep(self._lasting_s())
        self._replica.signal(signal.SIGCONT)

    def _delay_replica(self) -> None:
        """Nothing reaches it, and clients come that have been at the server until now."""
        assert self._upstream is not None
        self._upstream.hold()
        time.sleep(self._lasting_s() / 4)
        for slot in self._slots:
            if slot.has_others:
                slot.proxy.reset()
        time.sleep(self._lasting_s())
        self._upstream.release()

    # --- the network

    def _hold_network(self) -> None:
        """Messages of some clients arrive late, and those of others do not."""
        held = self._random.sample(self._slots, k=max(1, len(self._slots) // 2))
        for slot in held:
            slot.proxy.hold()
        time.sleep(self._lasting_s())
        for slot in held:
            slot.proxy.release()

    def _cut_network(self) -> None:
        self._one().proxy.cut()

    def _reset_network(self) -> None:
        for slot in self._random.sample(self._slots, k=max(1, len(self._slots) // 2)):
            slot.proxy.reset()

    def _delay_network(self) -> None:
        slot = self._one()
        slot.proxy.delay(self._random.uniform(0.001, 0.1))
        time.sleep(self._lasting_s())
        slot.proxy.delay(0)

    def _throttle_network(self) -> None:
        slot = self._one()
        slot.proxy.throttle(self._random.uniform(10_000, 100_000))
        time.sleep(self._lasting_s())
        slot.proxy.throttle(0)

    # --- clients

    def _freeze_client(self) -> None:
        slot = self._one()
        slot.signal(signal.SIGSTOP)
        time.sleep(self._lasting_s())
        slot.signal(signal.SIGCONT)

    def _kill_client(self) -> None:
        slot = self._one()
        slot.kill()
        slot.start(self._start_s, self._seed, self._endpoint)

    def _wrong_clock(self) -> None:
        """A sensor beside the tree has stamps of another year."""
        with contextlib.suppress(TransformException):
            tf = TransformClient.connect(self._endpoint, timeout_s=TIMEOUT_S, reads="query")
            with tf, tf.broadcaster("wrong clock") as sensor:
                for offset_ns in (_YEAR_NS, -_YEAR_NS, 0):
                    stamp_ns = time.time_ns() + offset_ns
                    sensor.send(StampedTransform("root", "beside", stamp_ns, Transform()))

    def _greedy_client(self) -> None:
        """A client asks for replies of 6.5 MB, is stopped, and dies."""
        command = [sys.executable, "-m", "tests.attack.attackers", "frozen", self._endpoint]
        with (
            contextlib.suppress(RuntimeError),
            Process([*command, "4", "100000"], folder=ROOT) as it,
        ):
            it.go()
            time.sleep(self._lasting_s())
