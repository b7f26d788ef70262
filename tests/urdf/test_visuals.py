"""What the links of a URDF file look like."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.urdf.shapes import URDF, write_urdf
from zenoh_tf import InvalidArgumentException
from zenoh_tf.urdf.visuals import Mesh, Solid, read_visuals
from zenoh_tf_tools.viewer.models import Model, ModelError


def test_each_shape(tmp_path: Path) -> None:
    path = write_urdf(tmp_path)
    box, cylinder, ball, hull = read_visuals(path)
    assert (box.link, box.shape, box.colour) == ("box_link", Solid("box", (1, 2, 3)), (0, 0, 1))
    np.testing.assert_allclose(box.origin.apply([1, 0, 0]), (0, 1, 0.5), atol=1e-12)
    assert (cylinder.shape, cylinder.colour) == (Solid("cylinder", (0.5, 4)), (1, 0.5, 0))
    assert (ball.shape, ball.colour) == (Solid("sphere", (0.25,)), None)
    assert isinstance(hull.shape, Mesh)
    assert hull.shape.path == (path.parents[1] / "hull.stl").resolve()


def test_models_are_as_large_as_their_shapes(tmp_path: Path) -> None:
    sizes = [
        np.ptp(Model(visual).corners, axis=0).round(3).tolist()
        for visual in read_visuals(write_urdf(tmp_path))
    ]
    # The box is turned by a quarter.
    assert sizes == [[2, 1, 3], [1, 1, 4], [0.5, 0.5, 0.5], [1, 1, 1]]


def test_ros_names_where_packages_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = write_urdf(tmp_path / "prefix/share").parents[1]
    other = tmp_path / "elsewhere.urdf"
    other.write_text(URDF)
    with pytest.raises(ModelError, match=r"'package://shapes/hull\.stl' not found; .*AMENT"):
        Model(read_visuals(other)[-1])
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{tmp_path / 'prefix'}")
    assert read_visuals(other)[-1].shape == Mesh(
        "package://shapes/hull.stl", package / "hull.stl", (0.001, 0.001, 0.001)
    )


def test_a_mesh_that_is_none(tmp_path: Path) -> None:
    path = write_urdf(tmp_path)
    (path.parents[1] / "hull.stl").write_bytes(b"solid \xff")
    with pytest.raises(ModelError, match=r"cannot read the mesh .*hull\.stl"):
        Model(read_visuals(path)[-1])


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ("<box size='1 2'/>", "link 'a': size='1 2' is not three numbers"),
        ("<sphere/>", "link 'a': its sphere has no size"),
        ("<cylinder radius='1' length='-1'/>", "link 'a': its cylinder has no size"),
        ("<cone/>", "link 'a': <cone> is no geometry of URDF"),
        ("", "link 'a': a <visual> has no geometry"),
    ],
)
def test_damaged_shapes(tmp_path: Path, shape: str, message: str) -> None:
    path = tmp_path / "a.urdf"
    visual = f"<visual><geometry>{shape}</geometry></visual>"
    path.write_text(f"<robot name='x'><link name='a'>{visual}</link></robot>")
    with pytest.raises(InvalidArgumentException) as caught:
        read_visuals(path)
    assert message in str(caught.value)
    assert caught.value.field == "a"
