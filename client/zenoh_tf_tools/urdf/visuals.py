"""Reads what the links of a URDF file look like: boxes, cylinders, spheres and names of meshes.

Thread safety: all functions.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from urllib.parse import unquote, urlsplit
from xml.etree.ElementTree import Element

from zenoh_tf import InvalidArgumentException, Transform

from .reader import name_of, numbers, read_xml

Rgb = tuple[float, float, float]

#: Where ROS looks for packages: ROS 2 in the folder `share` of these, ROS 1 in them.
_ROS_2_PATHS: Final = "AMENT_PREFIX_PATH"
_ROS_1_PATHS: Final = "ROS_PACKAGE_PATH"


@dataclass(frozen=True, slots=True)
class Box:
    """Its edges along x, y and z, in metres."""

    size: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Cylinder:
    """A cylinder about z, its middle in the origin. Metres."""

    radius: float
    length: float


@dataclass(frozen=True, slots=True)
class Sphere:
    """Metres."""

    radius: float


@dataclass(frozen=True, slots=True)
class Mesh:
    """A file of triangles.

    Attributes:
        name: As the URDF file names it.
        path: Where it was found; None if it was not.
        scale: What its coordinates along x, y and z are multiplied with to be metres.
    """

    name: str
    path: Path | None
    scale: tuple[float, ...]


Shape = Box | Cylinder | Sphere | Mesh


@dataclass(frozen=True, slots=True)
class Visual:
    """A part of what a link looks like.

    Attributes:
        link: The link.
        origin: The pose of the shape in the link, ``X_link_shape``.
        shape: Its form.
        colour: Red, green and blue, from 0 to 1; None if the file names none.
    """

    link: str
    origin: Transform
    shape: Shape
    colour: Rgb | None


def read_visuals(path: Path) -> list[Visual]:
    """Read what the links of a URDF file look like, in the order of the file.

    The file of a mesh is searched for, but not opened. ``package://NAME/...`` is searched for in
    the folders above the URDF file, and where ROS has its packages.

    Raises:
        InvalidArgumentException: The file is not URDF, or a shape is not valid.
        LimitExceeded: It is larger than `reader.MAX_BYTES`.
        OSError: It cannot be read.
    """
    root = read_xml(path)
    colours = {
        material.get("name", ""): colour
        for material in root.iter("material")
        if (colour := _colour(material, str(path), "")) is not None
    }
    return [visual for link in root.findall("link") for visual in _visuals(link, path, colours)]


def _visuals(link: Element, path: Path, colours: Mapping[str, Rgb]) -> Iterator[Visual]:
    name = name_of(link, str(path))
    for visual in link.findall("visual"):
        geometry = visual.find("geometry")
        if geometry is None or not len(geometry):
            raise _invalid(path, name, "a <visual> has no geometry")
        origin = visual.find("origin")
        xyz = numbers(origin, "xyz", (0.0, 0.0, 0.0), str(path), name, "link")
        roll, pitch, yaw = numbers(origin, "rpy", (0.0, 0.0, 0.0), str(path), name, "link")
        material = visual.find("material")
        colour = None
        if material is not None:
            colour = _colour(material, str(path), name) or colours.get(material.get("name", ""))
        yield Visual(
            name, Transform.from_rpy(roll, pitch, yaw, xyz), _shape(geometry[0], path, name), colour
        )


def _shape(element: Element, path: Path, link: str) -> Shape:
    def one(attribute: str) -> float:
        [value] = numbers(element, attribute, (0.0,), str(path), link, "link")
        return value

    shape: Shape
    match element.tag:
        case "box":
            size = numbers(element, "size", (0.0, 0.0, 0.0), str(path), link, "link")
            shape, sizes = Box(tuple(size)), tuple(size)
        case "cylinder":
            shape, sizes = Cylinder(one("radius"), one("length")), (one("radius"), one("length"))
        case "sphere":
            shape, sizes = Sphere(one("radius")), (one("radius"),)
        case "mesh":
            scale = numbers(element, "scale", (1.0, 1.0, 1.0), str(path), link, "link")
            filename = element.get("filename", "")
            return Mesh(filename, _mesh_path(filename, path), tuple(scale))
        case _:
            raise _invalid(path, link, f"<{element.tag}> is no geometry of URDF")
    if min(sizes) <= 0:
        raise _invalid(path, link, f"its {element.tag} has no size: {sizes}")
    return shape


def _mesh_path(name: str, urdf: Path) -> Path | None:
    url = urlsplit(name)
    inside = unquote(url.path)
    candidates: Iterable[Path] = ()
    if url.scheme == "package":
        candidates = (folder / inside.lstrip("/") for folder in _packages(url.netloc, urdf))
    elif url.scheme in ("", "file"):
        candidates = (urdf.parent / inside,)
    return next((path for path in candidates if path.is_file()), None)


def _packages(name: str, urdf: Path) -> Iterator[Path]:
    """The folders that may be the package of this name."""
    for folder in urdf.resolve().parents:
        if folder.name == name:
            yield folder
        yield folder / name
    for variable, below in ((_ROS_2_PATHS, "share"), (_ROS_1_PATHS, "")):
        for prefix in filter(None, os.environ.get(variable, "").split(os.pathsep)):
            yield Path(prefix) / below / name


def _colour(material: Element, source: str, link: str) -> Rgb | None:
    colour = material.find("color")
    if colour is None:
        return None
    red, green, blue, _ = numbers(colour, "rgba", (0.0, 0.0, 0.0, 1.0), source, link, "link")
    return red, green, blue


def _invalid(path: Path, link: str, reason: str) -> InvalidArgumentException:
    return InvalidArgumentException(f"{path}: link {link!r}: {reason}", field=link)
