"""Writes poses.json: where yourdfpy, another implementation, puts the links of examples/arm.urdf.

It needs more packages than the rest of the tests together, so its answers are kept:

    pip install yourdfpy && python tests/urdf/oracle.py
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve().parent
#: Beyond the limits of some joints as well: these do not bound the kinematics.
REACH = {"pan": 7.0, "elbow": 2.0, "slide": 0.4, "roll": 3.0, "left": 0.05}
CASES = 10


def main() -> None:
    import yourdfpy  # type: ignore[import-not-found]  # noqa: PLC0415

    robot = yourdfpy.URDF.load(str(HERE.parents[1] / "examples/arm.urdf"), load_meshes=False)
    random = np.random.default_rng(18)
    cases: list[dict[str, Any]] = []
    for _ in range(CASES):
        positions = {name: float(random.uniform(-far, far)) for name, far in REACH.items()}
        robot.update_cfg(positions)
        poses = {link: robot.get_transform(link, "base").tolist() for link in robot.link_map}
        cases.append({"positions": positions, "poses": poses})
    lines = ",\n".join(map(json.dumps, cases))
    (HERE / "poses.json").write_text(f"[\n{lines}\n]\n")


if __name__ == "__main__":
    main()
