"""A client that is written from docs/reference/protocol.md alone.

    python examples/protocol_client.py --connect tcp/127.0.0.1:7447

It needs eclipse-zenoh and msgpack, and nothing of this project: a starting point for a client in
another language. protocol_mirror.py follows the stream. Access rules, replicas and reads without
Zenoh are left out.
"""

from __future__ import annotations

import argparse
import os
import struct
import time
from typing import Any

import msgpack
import zenoh

NO_STAMP = -(1 << 63)
AT, COMMON = 0, 1  # operations of a lookup
CONFLICT, SERVER_BUSY = 10, 17  # codes of errors

Body = dict[str, Any]
Row = tuple[str, str, int, tuple[float, ...]]  # parent, child, stamp in ns, X_parent_child


class TfError(Exception):
    def __init__(self, error: Body) -> None:
        super().__init__(error["message"])
        self.code, self.facts = error["code"], error["facts"]


def escape(name: str) -> str:
    """A tree or an authority as a chunk of a key."""
    unsafe = {*"/*$?#%@ \u2028\u2029", *map(chr, range(0x20)), *map(chr, range(0x7F, 0xA0))}
    return (
        "".join(
            "".join(f"%{byte:02X}" for byte in char.encode()) if char in unsafe else char
            for char in name
        )
        or "%"
    )


def column(kind: str, values: list[Any]) -> bytes:
    return struct.pack(f"<{len(values)}{kind}", *values)


def values(kind: str, data: bytes) -> tuple[Any, ...]:
    return struct.unpack(f"<{len(data) // struct.calcsize(kind)}{kind}", data)


def poses(data: bytes) -> list[tuple[float, ...]]:
    return list(struct.iter_unpack("<7d", data))


def commit_body(rows: list[Row], **fields: Any) -> Body:
    names = sorted({name for row in rows for name in row[:2]})
    return {
        "names": names,
        "parent": column("I", [names.index(row[0]) for row in rows]),
        "child": column("I", [names.index(row[1]) for row in rows]),
        "stamp": column("q", [row[2] for row in rows]),
        "pose": column("d", [number for row in rows for number in row[3]]),
        **fields,
    }


def lookup_body(target: str, source: str, stamps: list[int | None], **fields: Any) -> Body:
    count = len(stamps)
    return {
        "names": [target, source],
        "op": bytes(COMMON if stamp is None else AT for stamp in stamps),
        "target": column("I", [0] * count),
        "source": column("I", [1] * count),
        "stamp": column("q", [NO_STAMP if stamp is None else stamp for stamp in stamps]),
        **fields,
    }


class Client:
    def __init__(self, endpoint: str, tree: str = "main", timeout_s: float = 10.0) -> None:
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", f'["{endpoint}"]')
        self.session = zenoh.open(config)
        self.prefix, self.timeout_s = f"tf/v1/{escape(tree)}", timeout_s
        self.id = str(self.session.zid())
        self.token = self.session.liveliness().declare_token(f"{self.prefix}/client/{self.id}")
        self.puts: dict[str, zenoh.Publisher] = {}
        self.server = self.hello()

    def close(self) -> None:
        self.session.close()

    def hello(self) -> Body:
        value: Body = self.ask("hello", {"what": "hello"})["value"]
        self.clock_ns = value["clock_ns"] - time.monotonic_ns()  # how far the server's is ahead
        return value

    def ask(self, kind: str, body: Body) -> Body:
        """The reply to a request, again while the server is busy."""
        payload = msgpack.packb({"v": 1, **body})
        until_s = time.monotonic() + self.timeout_s
        while True:
            reply = self._reply(kind, payload, until_s - time.monotonic())
            error = reply.get("error")
            if error is None:
                return reply
            pause_s = error["facts"].get("retry_after_s") or 0.1
            if error["code"] != SERVER_BUSY or time.monotonic() + pause_s > until_s:
                raise TfError(error)
            time.sleep(pause_s)

    def _reply(self, kind: str, payload: bytes, timeout_s: float) -> Body:
        data = b""
        for reply in self.session.get(
            f"{self.prefix}/{kind}",
            payload=payload,
            attachment=f"{self.id} parts",
            timeout=max(timeout_s, 0.001),
            consolidation=zenoh.ConsolidationMode.NONE,
        ):
            if reply.ok is None:
                data = reply.err.payload.to_bytes() if reply.err is not None else b""
                if data == b"Timeout":
                    raise TimeoutError("the server does not reply")
                return dict(msgpack.unpackb(data))
            data += reply.ok.payload.to_bytes()
            whole = reply.ok.attachment
            if whole is None or len(data) == int(whole.to_string()):
                return dict(msgpack.unpackb(data))
        raise ConnectionError("no server, or it went away")

    # --- reads and writes

    def lookup(
        self, target: str, source: str, *stamps: int | None, wait_s: float = 0.0
    ) -> list[tuple[int, tuple[float, ...]] | TfError]:
        """For each stamp, or None for the latest: the stamp and X_target_source, or an error."""
        fields = {"timeout_ns": int(wait_s * 1e9)} if wait_s else {}
        reply = self.ask("lookup", lookup_body(target, source, list(stamps), **fields))
        errors = {row: TfError(error) for row, error in reply["errors"]}
        found = zip(values("q", reply["stamp"]), poses(reply["pose"]), strict=True)
        return [errors.get(row) or answer for row, answer in enumerate(found)]

    def write(self, kind: str, body: Body) -> Body:
        """A commit, or a batch with some: it runs once, now or never."""
        expires_ns = time.monotonic_ns() + self.clock_ns + int(self.timeout_s * 1e9)
        once = {"id": os.urandom(16), "expires_ns": expires_ns, "instance": self.server["instance"]}
        return self.ask(kind, body | once)

    def set(self, rows: list[Row], **fields: Any) -> bytes:
        """One transaction: by row, 1 stored or 0 dropped."""
        stored: bytes = self.write("commit", commit_body(rows, **fields))["stored"]
        return stored

    def move(self, parent: str, child: str, by: tuple[float, float, float]) -> int:
        """Read a link and write it back moved, in one transaction. Returns the attempts."""
        for attempt in range(1, 100):
            found = self.ask("lookup", lookup_body(parent, child, [None], versions=True))
            if found["errors"]:
                raise TfError(found["errors"][0][1])
            (stamp_ns,), (pose,) = values("q", found["stamp"]), poses(found["pose"])
            moved = (*(a + b for a, b in zip(pose, by, strict=False)), *pose[3:])
            read = {key: found[key] for key in ("read_names", "read_versions")}
            try:
                self.set([(parent, child, stamp_ns + 1, moved)], **read)
                return attempt
            except TfError as error:
                if error.code != CONFLICT:
                    raise
        raise TimeoutError("too many conflicts")

    def publish(self, authority: str, rows: list[Row], kind: str = "set") -> None:
        """A put: nobody answers. `kind`: "set" or "static"."""
        key = f"{self.prefix}/{kind}/{escape(authority)}"
        if key not in self.puts:
            block = zenoh.CongestionControl.BLOCK
            self.puts[key] = self.session.declare_publisher(key, congestion_control=block)
        self.puts[key].put(msgpack.packb({"v": 1, **commit_body(rows)}))


def connect() -> Client:
    parser = argparse.ArgumentParser()
    parser.add_argument("--connect", default="tcp/127.0.0.1:7447", metavar="ENDPOINT")
    return Client(parser.parse_args().connect)


def main() -> None:
    client = connect()
    now_ns = time.time_ns()
    client.publish("lidar", [("base", "lidar", now_ns, (0, 0, 0.5, 0, 0, 0, 1))], "static")
    client.set([("map", "base", now_ns, (1, 2, 0, 0, 0, 0, 1))], authority="example")
    print(client.move("map", "base", (0.5, 0, 0)), "attempt of a transaction")
    print("lidar in map:", *client.lookup("map", "lidar", None, wait_s=5.0))
    print("an error:", *client.lookup("map", "nowhere", None))
    client.close()


if __name__ == "__main__":
    main()
