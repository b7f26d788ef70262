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

from zenoh_tf import Transform

from .reader import Part, name_of, read_xml

Rgb = tuple[float, float, float]

#: Where ROS looks for packages: ROS 2 in the folder `share` of these, ROS 1 in them.
_ROS_2_PATHS: Final = "AMENT_PREFIX_PATH"
_ROS_1_PATHS: Final = "ROS_PACKAGE_PATH"


@dataclass(frozen=True, slots=True)
class Solid:
    """A box, a cylinder about z, or a sphere, its middle in the origin.

    Attributes:
        kind: As URDF names it: "box", "cylinder" or "sphere".
        sizes: The edges along x, y and z; the radius and the length; the radius. Metres.
    """

    kind: str
    sizes: tuple[float, ...]


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


Shape = Solid | Mesh


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
    nobody = Part(str(path), "link", "")  # a material may stand outside of all links
    colours = {
        material.get("name", ""): colour
        for material in root.iter("material")
        if (colour := _colour(material, nobody)) is not None
    }
    return [visual for link in root.findall("link") for visual in _visuals(link, path, colours)]


def _visuals(element: Element, path: Path, colours: Mapping[str, Rgb]) -> Iterator[Visual]:
    link = Part(str(path), "link", name_of(element, str(path)))
    for visual in element.findall("visual"):
        geometry = visual.find("geometry")
        if geometry is None or not len(geometry):
            raise link.invalid("a <visual> has no geometry")
        origin = link.origin(visual)
        material = visual.find("material")
        colour = None
        if material is not None:
            colour = _colour(material, link) or colours.get(material.get("name", ""))
        for pose, shape in _parts(_shape(geometry[0], path, link)):
            yield Visual(link.name, origin @ pose, shape, colour)


def _parts(shape: Shape) -> list[tuple[Transform, Shape]]:
    """A capsule, of URDF 1.1, as a cylinder with a ball at each end; other shapes as they are."""
    if not isinstance(shape, Solid) or shape.kind != "capsule":
        return [(Transform(), shape)]
    radius, length = shape.sizes
    ball, ends = Solid("sphere", (radius,)), (-length / 2, length / 2)
    return [
        (Transform(), Solid("cylinder", shape.sizes)),
        *((Transform((0.0, 0.0, z)), ball) for z in ends),
    ]


def _shape(element: Element, path: Path, link: Part) -> Shape:
    def one(attribute: str) -> float:
        [value] = link.numbers(element, attribute, (0.0,))
        return value

    match element.tag:
        case "box":
            sizes = link.numbers(element, "size", (0.0, 0.0, 0.0))
        case "cylinder" | "capsule":
            sizes = [one("radius"), one("length")]
        case "sphere":
            sizes = [one("radius")]
        case "mesh":
            scale = link.numbers(element, "scale", (1.0, 1.0, 1.0))
            filename = element.get("filename", "")
            return Mesh(filename, _mesh_path(filename, path), tuple(scale))
        case _:
            raise link.invalid(f"<{element.tag}> is no geometry of URDF")
    if min(sizes) <= 0:
        raise link.invalid(f"its {element.tag} has no size: {tuple(sizes)}")
    return Solid(element.tag, tuple(sizes))


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


def _colour(material: Element, owner: Part) -> Rgb | None:
    colour = material.find("color")
    if colour is None:
        return None
    red, green, blue, _ = owner.numbers(colour, "rgba", (0.0, 0.0, 0.0, 1.0))
    return red, green, blue
