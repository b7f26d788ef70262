"""Calibrations as files: named, versioned sets of static links, one TOML file per version.

The file of version 2 of `cell` is `cell@2.toml`. It is never changed: the next save makes the
next version.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import re
import tempfile
import time
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from zenoh_tf import StampedTransform, Transform, TransformException
from zenoh_tf_tools.errors import CommandError

_FORMAT: Final = 1
_FILE_NAME: Final = re.compile(r"(?P<name>.+)@(?P<version>[1-9][0-9]*)\.toml")
_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")
#: A quaternion written by hand may have few digits; the server makes its length 1.
_ROTATION_TOLERANCE: Final = 1e-3
#: Stands for the links of the server.
LIVE: Final = "live"

#: The static links of a calibration or a tree, by child frame.
Links = Mapping[str, StampedTransform]


@dataclass(frozen=True)
class Reference:
    """NAME, the newest version, or NAME@VERSION."""

    name: str
    version: int | None = None

    def __str__(self) -> str:
        return self.name if self.version is None else f"{self.name}@{self.version}"


@dataclass(frozen=True)
class Calibration:
    """One version of a set of static links."""

    reference: Reference
    saved: str  # ISO 8601, UTC
    tree: str
    note: str
    links: Links


def default_folder() -> Path:
    """Where calibrations are kept by default: in the user's data folder."""
    data = os.environ.get("XDG_DATA_HOME") or str(Path("~/.local/share").expanduser())
    return Path(data) / "zenoh-tf" / "calibrations"


def parse_name(text: str) -> str:
    """The name of a calibration, which is also part of a file's name.

    Raises ValueError, with a message, if it is no such name.
    """
    if text == LIVE or not _NAME.fullmatch(text):
        raise ValueError(
            f"{text!r} is not a name: use letters, digits, '.', '_' and '-', and not {LIVE!r}"
        )
    return text


def parse_reference(text: str) -> Reference:
    """NAME or NAME@VERSION. Raises ValueError, with a message, for anything else."""
    name, at, version = text.partition("@")
    if not at:
        return Reference(parse_name(name))
    if not (version.isascii() and version.isdigit() and int(version) > 0):
        raise ValueError(f"{text!r} is not NAME or NAME@VERSION")
    return Reference(parse_name(name), int(version))


class Folder:
    """The calibrations in one folder."""

    def __init__(self, path: Path) -> None:
        """The folder need not exist yet."""
        self.path = path

    def references(self, name: str | None = None) -> list[Reference]:
        """All versions of one calibration or of all, sorted."""
        try:
            files = sorted(path.name for path in self.path.iterdir())
        except FileNotFoundError:
            return []
        except OSError as error:
            raise CommandError(f"cannot read {self.path}: {error.strerror}") from error
        found = [match for file in files if (match := _FILE_NAME.fullmatch(file))]
        all_ = [Reference(match["name"], int(match["version"])) for match in found]
        chosen = [each for each in all_ if name is None or each.name == name]
        return sorted(chosen, key=lambda each: (each.name, each.version or 0))

    def load(self, reference: Reference) -> Calibration:
        """Read one version, the newest if none is named.

        Raises:
            CommandError: There is no such calibration, or its file is malformed.
        """
        if reference.version is None:
            versions = self.references(reference.name)
            if not versions:
                raise CommandError(f"no calibration {reference} in {self.path}{self._known()}")
            reference = versions[-1]
        path = self._file(reference)
        try:
            return _parse(reference, tomllib.loads(path.read_text(encoding="utf-8")))
        except FileNotFoundError as error:
            versions = self.references(reference.name)
            known = ", ".join(map(str, versions)) or "none"
            raise CommandError(f"no {reference} in {self.path}; there is {known}") from error
        except (OSError, ValueError) as error:  # ValueError: also not UTF-8, or not TOML
            raise CommandError(f"cannot read {path}: {error}") from error
        except RecursionError:
            raise CommandError(f"cannot read {path}: it is nested too deeply") from None

    def save(self, name: str, links: Links, tree: str, note: str) -> Calibration:
        """Write the next version of a calibration. Another program that saves the same one at the
        same time gets the version after it.

        Raises:
            CommandError: The file cannot be written.
        """
        saved = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            while True:
                versions = self.references(name)
                version = 1 + (versions[-1].version or 0) if versions else 1
                calibration = Calibration(Reference(name, version), saved, tree, note, links)
                with contextlib.suppress(FileExistsError):
                    self._write(self._file(calibration.reference), text(calibration))
                    return calibration
        except OSError as error:
            raise CommandError(f"cannot write to {self.path}: {error.strerror}") from error

    def _write(self, path: Path, content: str) -> None:
        """Make a file that is whole or not there. Raises FileExistsError."""
        with tempfile.NamedTemporaryFile("w", dir=self.path, encoding="utf-8") as draft:
            draft.write(content)
            draft.flush()
            os.fsync(draft.fileno())
            os.fchmod(draft.fileno(), 0o644)
            os.link(draft.name, path)

    def _file(self, reference: Reference) -> Path:
        return self.path / f"{reference}.toml"

    def _known(self) -> str:
        names = sorted({each.name for each in self.references()})
        return f"; there is {', '.join(names)}" if names else ", which has none (--dir)"


def text(calibration: Calibration) -> str:
    """The file of a calibration: a block of lines per link, in the order of the child frames."""
    lines = [
        "# A calibration of zenoh-tf: static poses of child in parent.",
        "# translation in metres, rotation as quaternion x y z w",
        f"format = {_FORMAT}",
        f"saved = {_quoted(calibration.saved)}",
        f"tree = {_quoted(calibration.tree)}",
        f"note = {_quoted(calibration.note)}",
    ]
    for child, link in sorted(calibration.links.items()):
        lines += [
            "",
            "[[link]]",
            f"child = {_quoted(child)}",
            f"parent = {_quoted(link.parent_frame)}",
            f"translation = {_numbers(link.transform.translation.tolist())}",
            f"rotation = {_numbers(link.transform.rotation.tolist())}",
        ]
    return "\n".join(lines) + "\n"


def _quoted(value: str) -> str:
    """A TOML string: JSON's form, which leaves only DEL to be escaped."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007F")


def _numbers(values: Sequence[float]) -> str:
    return "[" + ", ".join(repr(value + 0.0) for value in values) + "]"


def _parse(reference: Reference, document: dict[str, Any]) -> Calibration:
    """The calibration in a file. Raises ValueError, with a message, if it is malformed."""
    found = _field(document, "format", int)
    if found != _FORMAT:
        raise ValueError(f"format is {found}, and this zenoh-tf knows {_FORMAT}")
    links: dict[str, StampedTransform] = {}
    for number, entry in enumerate(_field(document, "link", list), start=1):
        where = f" of link {number}"
        if not isinstance(entry, dict):
            raise ValueError(f"link {number} is not a table")
        child = _field(entry, "child", str, where)
        if child in links:
            raise ValueError(f"{child!r} is there twice")
        parent = _field(entry, "parent", str, where)
        translation = _vector(entry, "translation", 3, where)
        rotation = _vector(entry, "rotation", 4, where)
        if abs(math.hypot(*rotation) - 1) > _ROTATION_TOLERANCE:
            raise ValueError(f"rotation{where} is not a unit quaternion")
        try:
            links[child] = StampedTransform(parent, child, 0, Transform(translation, rotation))
        except (TransformException, ValueError) as error:
            raise ValueError(f"link {number}, {child!r}: {error}") from error
    saved, tree, note = (_field(document, name, str) for name in ("saved", "tree", "note"))
    return Calibration(reference, saved, tree, note, links)


def _field(table: dict[str, Any], name: str, kind: type, where: str = "") -> Any:
    value = table.get(name)
    if not isinstance(value, kind) or isinstance(value, bool):
        raise ValueError(f"{name}{where} is missing, or not of type {kind.__name__}")
    return value


def _vector(table: dict[str, Any], name: str, size: int, where: str) -> list[float]:
    values = _field(table, name, list, where)
    numbers = [float(value) for value in values if type(value) in (int, float)]
    if len(values) != size or len(numbers) != size or not all(map(math.isfinite, numbers)):
        raise ValueError(f"{name}{where} is not {size} finite numbers")
    return numbers
