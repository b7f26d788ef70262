"""A URDF file with a shape of each kind."""

from __future__ import annotations

from pathlib import Path

URDF = """<robot name="shapes">
  <material name="blue"><color rgba="0 0 1 1"/></material>
  <link name="box_link">
    <visual>
      <origin xyz="0 0 0.5" rpy="0 0 1.5707963267948966"/>
      <geometry><box size="1 2 3"/></geometry><material name="blue"/>
    </visual>
    <visual>
      <geometry><cylinder radius="0.5" length="4"/></geometry>
      <material name="own"><color rgba="1 0.5 0 1"/></material>
    </visual>
  </link>
  <link name="ball"><visual><geometry><sphere radius="0.25"/></geometry></visual></link>
  <link name="hull">
    <visual>
      <geometry><mesh filename="package://shapes/hull.stl" scale="0.001 0.001 0.001"/></geometry>
    </visual>
    <collision><geometry><box size="9 9 9"/></geometry></collision>
  </link>
</robot>
"""


def write_urdf(folder: Path, text: str = URDF) -> Path:
    """Write it as shapes/urdf/robot.urdf below a folder, with shapes/hull.stl, of 1 m in mm."""
    package = folder / "shapes"
    path = package / "urdf/robot.urdf"
    path.parent.mkdir(parents=True)
    path.write_text(text)
    corners = ("0 0 0", "1000 0 0", "0 1000 0", "0 0 1000")
    facets = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    lines = ["solid hull"]
    for facet in facets:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {corners[corner]}" for corner in facet]
        lines += ["endloop", "endfacet"]
    (package / "hull.stl").write_text("\n".join([*lines, "endsolid hull", ""]))
    return path
