"""Reads the links and joints of a URDF file; meshes, inertias and the like are left out.

The file is parsed with the standard library. The URDF libraries on PyPI bring meshes, geometry
engines or plotting with them, hundreds of megabytes, for the few elements that are needed here. A
file with a document type is refused, so that no entity is expanded and nothing else is opened.

Thread safety: all functions.
"""

from __future__ import annotations

import codecs
import math
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, NoReturn
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from zenoh_tf import InvalidArgumentException, LimitExceeded, Transform
from zenoh_tf.text import quoted
from zenoh_tf.text.similar import did_you_mean

#: Larger files are not descriptions of a robot, which name their meshes instead of having them.
MAX_BYTES: Final = 64 << 20
#: The joints that a position moves.
MOVING: Final = ("revolute", "continuous", "prismatic")
#: Those that need more than one number, which JointState does not have.
UNSUPPORTED: Final = ("floating", "planar")
#: Misspelt names for which similar ones are searched, at a cost of the number of joints each.
_MAX_HINTS: Final = 3
_KINDS: Final = ("fixed", *MOVING, *UNSUPPORTED)
#: Other parsers take what stands before the declaration here; expat does not.
_BEFORE: Final = re.compile(rb"\s+|<!--.*?-->", re.DOTALL)
_DECLARATION: Final = re.compile(rb"<\?xml\s")
_DECLARED: Final = re.compile(rb"""<\?xml\s[^>]*?\bencoding\s*=\s*["']([\w.:-]+)""")
#: Encodings that expat cannot read before Python 3.15, but Python can.
_MULTI_BYTE: Final = frozenset(
    ("gb2312", "gbk", "gb18030", "big5", "big5hkscs", "shift_jis", "euc_jp", "euc_kr", "johab")
) | {"cp932", "cp949", "cp950"}


@dataclass(frozen=True, slots=True)
class Mimic:
    """The position is that of another joint: multiplier * position + offset."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint of a robot. Metres, radians."""

    name: str
    kind: str  # a type of URDF
    parent: str
    child: str
    origin: Transform  # ``X_parent_child`` at position 0
    axis: NDArray[np.float64]  # (3,) unit vector, in the child's axes
    mimic: Mimic | None
    lower: float  # -inf if there is no limit
    upper: float


@dataclass(frozen=True, slots=True)
class Robot:
    """A robot: joints in the order of the file."""

    name: str
    root: str  # the link that is no joint's child
    joints: tuple[Joint, ...]
    warnings: tuple[str, ...] = ()  # what of the file was left out, and why

    def of_kind(self, *kinds: str) -> list[Joint]:
        """The joints of these types."""
        return [joint for joint in self.joints if joint.kind in kinds]


def read(path: Path) -> Robot:
    """Read a URDF file.

    Raises:
        InvalidArgumentException: The file is not URDF, or its joints are not a tree; `field` has
            the name of the joint or link, if it is about one.
        LimitExceeded: It is larger than `MAX_BYTES`.
        OSError: It cannot be read.
    """
    return parse(_text(path), str(path))


def parse(text: bytes, source: str = "URDF") -> Robot:
    """Parse URDF; as `read`. `source` stands at the beginning of errors."""
    root = _parse_xml(text, source)
    links = [name_of(element, source) for element in root.findall("link")]
    # A transmission has elements named joint as well, but deeper in the file.
    joints = [_joint(element, source) for element in root.findall("joint")]
    base = _check_tree(links, joints, source)
    warnings = _drop_mimics(joints, source)
    return Robot(root.get("name", ""), base, tuple(joints), tuple(warnings))


def read_xml(path: Path) -> Element:
    """Read the element <robot> of a URDF file. Raises as `read`, but for what is in it."""
    return _parse_xml(_text(path), str(path))


def _text(path: Path) -> bytes:
    with path.open("rb") as file:
        text = file.read(MAX_BYTES + 1)
    if len(text) > MAX_BYTES:
        raise LimitExceeded(
            f"{path}: larger than the limit of {MAX_BYTES:,} bytes", field="bytes", limit=MAX_BYTES
        )
    return text


def _parse_xml(text: bytes, source: str) -> Element:
    text, encoding = _readable(text, source)
    parser, builder = expat.ParserCreate(encoding), TreeBuilder()

    def start(tag: str, attributes: dict[str, str]) -> None:
        if tag.startswith("xacro:"):
            raise InvalidArgumentException(
                f"{source}, line {parser.CurrentLineNumber}: <{tag}> is xacro; expand the file "
                "first: xacro robot.urdf.xacro > robot.urdf"
            )
        builder.start(tag, attributes)

    def refuse(*_: object) -> NoReturn:
        raise InvalidArgumentException(f"{source}: a document type (<!DOCTYPE>) is not allowed")

    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler = start
    parser.EndElementHandler = builder.end
    try:
        parser.Parse(text, True)
    except InvalidArgumentException:  # of a handler; it is a ValueError as well
        raise
    except expat.ExpatError as error:
        raise InvalidArgumentException(f"{source}: not XML: {error}") from error
    except (LookupError, ValueError) as error:  # of an encoding that expat cannot read
        raise _unreadable(text, source) from error
    root = builder.close()
    if root.tag != "robot":
        raise InvalidArgumentException(f"{source}: the root element is <{root.tag}>, not <robot>")
    return root


def _readable(text: bytes, source: str) -> tuple[bytes, str | None]:
    """The text in an encoding that expat reads, and its name; None: as the text declares."""
    begin = len(codecs.BOM_UTF8) if text.startswith(codecs.BOM_UTF8) else 0
    while before := _BEFORE.match(text, begin):
        begin = before.end()
    if _DECLARATION.match(text, begin):
        text = text[begin:]
    declared = _DECLARED.match(text)
    try:
        name = codecs.lookup(declared[1].decode()).name if declared else ""
        if name in _MULTI_BYTE:
            return text.decode(name).encode(), "utf-8"
    except LookupError:
        pass
    except UnicodeDecodeError as error:
        raise InvalidArgumentException(f"{source}: {error}; is it of another encoding?") from error
    return text, None


def _unreadable(text: bytes, source: str) -> InvalidArgumentException:
    declared = _DECLARED.match(text)
    name = declared[1].decode() if declared else "it declares"
    return InvalidArgumentException(
        f"{source}: not XML: the encoding {name} cannot be read; save the file as UTF-8"
    )


@dataclass(frozen=True, slots=True)
class Part:
    """A joint or link of a file, whose errors name both."""

    source: str
    kind: str  # "joint" or "link"
    name: str

    def invalid(self, reason: str) -> InvalidArgumentException:
        """The error of something that is wrong with it."""
        return InvalidArgumentException(
            f"{self.source}: {self.kind} {self.name!r}: {reason}", field=self.name
        )

    def numbers(
        self,
        element: Element | None,
        attribute: str,
        default: Sequence[float],
        is_valid: Callable[[float], bool] = math.isfinite,
    ) -> list[float]:
        """The valid numbers of an attribute, as many as `default` has, which holds if the element
        or the attribute is left out. Raises InvalidArgumentException if they are others."""
        text = None if element is None else element.get(attribute)
        if text is None:
            return list(default)
        try:
            values = [float(word) for word in text.split()]
        except ValueError:
            values = []
        if len(values) != len(default) or not all(map(is_valid, values)):
            count = {1: "a number", 3: "three numbers", 4: "four numbers"}[len(default)]
            raise self.invalid(f"{attribute}={text[:80]!r} is not {count}")
        return values

    def origin(self, element: Element) -> Transform:
        """The pose that the <origin> in an element says; the identity if it has none."""
        origin = element.find("origin")
        xyz = self.numbers(origin, "xyz", (0.0, 0.0, 0.0))
        if origin is not None and "quat_xyzw" in origin.attrib:  # of URDF 1.1
            if "rpy" in origin.attrib:
                raise self.invalid("its <origin> has rpy and quat_xyzw, which say the same")
            rotation = np.array(self.numbers(origin, "quat_xyzw", (0.0, 0.0, 0.0, 1.0)))
            length = float(np.linalg.norm(rotation))
            if not 0.9 < length < 1.1:
                raise self.invalid(f"quat_xyzw has the length {length:.3f}, not 1")
            return Transform(xyz, rotation / length)
        roll, pitch, yaw = self.numbers(origin, "rpy", (0.0, 0.0, 0.0))
        return Transform.from_rpy(roll, pitch, yaw, xyz)


def _joint(element: Element, source: str) -> Joint:
    part = Part(source, "joint", name_of(element, source))
    kind = element.get("type", "")
    if kind not in _KINDS:
        raise part.invalid(f"its type is {kind!r}, not one of {', '.join(_KINDS)}")
    parent, child = (_link(element, tag, part) for tag in ("parent", "child"))
    origin = part.origin(element)
    axis = np.array(part.numbers(element.find("axis"), "xyz", (1.0, 0.0, 0.0)))
    if kind in MOVING:
        length = float(np.linalg.norm(axis))
        if not 1e-6 < length < 1e6:
            raise part.invalid(f"its axis {axis.tolist()} has no direction")
        axis /= length
    limit = element.find("limit")
    lower, upper = -math.inf, math.inf
    if limit is not None and kind in ("revolute", "prismatic"):
        [lower] = part.numbers(limit, "lower", (0.0,), _is_limit)  # the default of URDF
        [upper] = part.numbers(limit, "upper", (0.0,), _is_limit)
    mimic = element.find("mimic")
    moved = None if mimic is None or kind not in MOVING else _mimic(mimic, part)
    return Joint(part.name, kind, parent, child, origin, axis, moved, lower, upper)


def _is_limit(value: float) -> bool:
    return not math.isnan(value)  # infinite: there is none


def _link(element: Element, tag: str, joint: Part) -> str:
    end = element.find(tag)
    link = "" if end is None else end.get("link", "")
    if not link:
        raise joint.invalid(f"it has no <{tag} link=...>")
    return link


def _mimic(element: Element, joint: Part) -> Mimic:
    other = element.get("joint", "")
    if not other:
        raise joint.invalid("its <mimic> names no joint")
    [multiplier] = joint.numbers(element, "multiplier", (1.0,))
    [offset] = joint.numbers(element, "offset", (0.0,))
    return Mimic(other, multiplier, offset)


def _check_tree(links: Sequence[str], joints: Sequence[Joint], source: str) -> str:
    """Return the root link. Raises InvalidArgumentException if the links are not one tree."""
    for kind, names in (("link", links), ("joint", [joint.name for joint in joints])):
        if twice := _repeated(names):
            raise InvalidArgumentException(f"{source}: two {kind}s {twice!r}", field=twice)
    known = set(links)
    for joint in joints:
        for link in (joint.parent, joint.child):
            if link not in known:
                raise Part(source, "joint", joint.name).invalid(f"there is no link {link!r}")
    if twice := _repeated([joint.child for joint in joints]):
        raise InvalidArgumentException(
            f"{source}: link {twice!r} is the child of two joints", field=twice
        )
    children = {joint.child: joint for joint in joints}
    roots = [link for link in links if link not in children]
    if len(roots) > 1:
        named = ", ".join(map(repr, roots[:5]))
        raise InvalidArgumentException(
            f"{source}: {len(roots)} links are no joint's child, so nothing connects them: {named}",
            field=roots[1],
        )
    _check_loops(children, roots, source)
    return roots[0]


def _check_loops(children: dict[str, Joint], roots: Sequence[str], source: str) -> None:
    reaches_root = set(roots)
    for joint in children.values():
        path, link = {joint.child}, joint.parent
        while link not in reaches_root:
            if link in path:
                raise Part(source, "joint", joint.name).invalid("its links are a loop")
            path.add(link)
            link = children[link].parent
        reaches_root |= path
    if not roots:
        raise InvalidArgumentException(f"{source}: the robot has no links")


def _drop_mimics(joints: list[Joint], source: str) -> list[str]:
    """Remove the <mimic> of joints that name no joint that moves, and return a warning for each.

    Such a joint moves only where a message names it. Raises InvalidArgumentException if a joint
    mimics itself, alone or through others.
    """
    by_name = {joint.name: joint for joint in joints}
    warnings: list[str] = []
    for at, joint in enumerate(joints):
        mimic = joint.mimic
        if mimic is None:
            continue
        leader = by_name.get(mimic.joint)
        if leader is not None and leader.kind in MOVING:
            continue
        why = "does not exist" if leader is None else f"is {leader.kind}"
        hint = None
        if leader is None and len(warnings) < _MAX_HINTS:
            hint = did_you_mean(mimic.joint, by_name.keys())
        warnings.append(
            f"{source}: joint {quoted(joint.name)}: it mimics {quoted(mimic.joint)}, which {why}; "
            f"its <mimic> is ignored{f' ({hint})' if hint else ''}"
        )
        joints[at] = by_name[joint.name] = replace(joint, mimic=None)
    _check_mimics(by_name, source)
    return warnings


def _check_mimics(joints: dict[str, Joint], source: str) -> None:
    ends: set[str] = set()  # joints whose leaders are known to end
    for joint in joints.values():
        followed: dict[str, None] = {}
        each = joint
        while each.mimic is not None and each.name not in ends:
            if each.name in followed:
                raise Part(source, "joint", each.name).invalid("it mimics itself")
            followed[each.name] = None
            each = joints[each.mimic.joint]
        ends.update(followed)


def _repeated(names: Sequence[str]) -> str | None:
    return next((name for name, count in Counter(names).items() if count > 1), None)


def name_of(element: Element, source: str) -> str:
    """The name of an element. Raises InvalidArgumentException if it has none."""
    name = element.get("name", "")
    if not name:
        raise InvalidArgumentException(f"{source}: a <{element.tag}> has no name")
    return name
