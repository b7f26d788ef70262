"""Draws the pictures of docs/how-to/view.md: ``python -m scripts.view_pictures``.

It makes recordings and a server, shows them with `zenoh-tf view`, and photographs the page in
Chromium, without a screen (Debian: ``apt-get install chromium``). Needs minutes: the pictures are
drawn in software.
"""

from __future__ import annotations

import contextlib
import io
import math
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
from PIL import Image
from playwright.sync_api import Page, sync_playwright

from zenoh_tf import StampedTransform, Transform
from zenoh_tf._core import TransformRows
from zenoh_tf.recordings.writer import RecordingWriter
from zenoh_tf.urdf.kinematics import JointTransforms, fixed_transforms
from zenoh_tf.urdf.reader import read
from zenoh_tf_client import TransformClient

ROOT: Final = Path(__file__).resolve().parents[1]
FIGURES: Final = ROOT / "docs/figures"
ARM: Final = ROOT / "examples/arm.urdf"
#: The vehicle that carries the arm.
CART: Final = """<robot name="cart"><link name="base_link">
<visual><origin xyz="0 0 0.25"/><geometry><box size="1.2 0.8 0.3"/></geometry>
<material name="m"><color rgba="0.3 0.45 0.7 1"/></material></visual>
{wheels}</link></robot>"""
WHEEL: Final = """<visual><origin xyz="{x} {y} 0.15" rpy="1.5708 0 0"/><geometry>
<cylinder radius="0.15" length="0.1"/></geometry>
<material name="m{x}{y}"><color rgba="0.2 0.2 0.2 1"/></material></visual>"""
#: When the recordings begin, in seconds.
START_S: Final = 1_700_000_000
SOFTWARE: Final = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
WINDOW: Final = {"width": 1280, "height": 720}
PHONE: Final[Any] = {
    "viewport": {"width": 390, "height": 844},
    "is_mobile": True,
    "has_touch": True,
}

Row = tuple[str, str, Transform]


def planar(x: float, y: float, yaw: float = 0.0, z: float = 0.0) -> Transform:
    """A pose on the floor."""
    return Transform.from_rpy(0, 0, yaw, (x, y, z))


class Writer:
    """A recording."""

    def __init__(self, path: Path) -> None:
        self._writer = RecordingWriter(path, {})

    def add(self, at_s: float, rows: Iterable[Row], *, static: bool = False) -> None:
        """Add a message so many seconds after the beginning."""
        stamp_ns = START_S * 10**9 + round(at_s * 1e9)
        stamped = [StampedTransform(parent, child, stamp_ns, X) for parent, child, X in rows]
        names = list(dict.fromkeys(x for s in stamped for x in (s.parent_frame, s.child_frame)))
        number = {name: index for index, name in enumerate(names)}
        self._writer.write(
            stamp_ns,
            static,
            TransformRows(
                names,
                np.array([number[s.parent_frame] for s in stamped], np.uint32),
                np.array([number[s.child_frame] for s in stamped], np.uint32),
                np.array([s.stamp_ns for s in stamped], np.int64),
                np.array([s.transform.pose() for s in stamped]),
            ),
        )

    def close(self) -> None:
        """End the file."""
        self._writer.close()


def robot(path: Path, *, cup: bool = False, late_s: float = 0.0) -> None:
    """A vehicle with an arm drives for ten seconds; its lidar stops after six.

    Args:
        path: Where the recording is made.
        cup: Whether two programs publish where a cup is.
        late_s: When the lidar begins.
    """
    writer, arm = Writer(path), read(ARM)
    joints = JointTransforms(arm)
    mounts = [
        ("base_link", "base", planar(0.2, 0, z=0.4)),
        ("base_link", "gps", planar(-0.5, 0, z=0.6)),
    ]
    fixed = [(s.parent_frame, s.child_frame, s.transform) for s in fixed_transforms(arm)]
    writer.add(0, [*mounts, *fixed, ("map", "table", planar(4, 2.5, z=0.7))], static=True)
    for number in range(301):
        t = number / 30
        turn = 0.35 * t
        rows = [
            ("map", "odom", planar(0.5, 0.2, 0.05)),
            ("odom", "base_link", planar(2 * math.sin(turn), 2 - 2 * math.cos(turn), turn)),
        ]
        if late_s <= t < 6:
            rows.append(("base_link", "lidar", planar(0.5, 0, 5 * t, 0.5)))
        positions = np.array([0.6 * math.sin(0.6 * t), 0.4 + 0.4 * math.sin(0.5 * t), 0.1, t, 0.03])
        moved = joints.move(["pan", "elbow", "slide", "roll", "left"], positions, 0)
        rows += [
            (moved.names[parent], moved.names[child], Transform.from_pose(pose))
            for parent, child, pose in zip(moved.parent, moved.child, moved.pose, strict=True)
        ]
        writer.add(t, rows)
        if cup:
            writer.add(t, [("table", "cup", planar(-0.8, -0.6, z=0.1))])
            writer.add(t + 0.01, [("tool", "cup", planar(0, 0, z=0.1))])
    writer.close()


def fleet(path: Path) -> None:
    """25 vehicles of 20 frames in a hall."""
    writer = Writer(path)
    sensors = ("imu", "gps", "lidar", "lidar_front", "lidar_rear", "camera", "camera_depth")
    others = ("camera_rgb", "wheel_fl", "wheel_fr", "wheel_rl", "wheel_rr", "bumper")
    arm = ("arm_base", "shoulder", "elbow", "wrist", "tool")
    parts = sensors + others
    for robot_number in range(25):
        name = f"r{robot_number}"
        ring = [2 * math.pi * at / len(parts) for at in range(len(parts))]
        writer.add(
            0,
            [
                (
                    f"{name}/base",
                    f"{name}/{part}",
                    planar(0.5 * math.cos(a), 0.4 * math.sin(a), a, 0.2),
                )
                for part, a in zip(parts, ring, strict=True)
            ],
            static=True,
        )
        for number in range(31):
            t = number / 10
            turn = 0.3 * t + robot_number
            rows = [
                ("map", f"{name}/odom", planar(robot_number % 5 * 6, robot_number // 5 * 6)),
                (
                    f"{name}/odom",
                    f"{name}/base",
                    planar(2 * math.cos(turn), 2 * math.sin(turn), turn + math.pi / 2),
                ),
            ]
            above = f"{name}/base"
            for at, part in enumerate(arm):
                bend = Transform.from_rpy(0, 0.5 * math.sin(t + at + robot_number), 0, (0, 0, 0.3))
                rows.append((above, f"{name}/{part}", bend))
                above = f"{name}/{part}"
            writer.add(t, rows)
    writer.close()


@contextlib.contextmanager
def serving(publish: Callable[[TransformClient, threading.Event], None]) -> Iterator[str]:
    """A server that a thread publishes to. Yields the server's endpoint, ten seconds later."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    command = [sys.executable, "-m", "zenoh_tf_server", "--listen", endpoint]
    server = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    ended = threading.Event()
    try:
        with TransformClient.connect(endpoint, timeout_s=10.0) as tf:
            publisher = threading.Thread(target=publish, args=(tf, ended))
            publisher.start()
            try:
                time.sleep(10.0)
                yield endpoint
            finally:
                ended.set()
                publisher.join()
    finally:
        server.terminate()
        server.wait()


def localise(tf: TransformClient, ended: threading.Event) -> None:
    """A vehicle drives straight on. Its localiser is 0.25 s late, and off by 2 cm."""
    for name, mount in {"lidar": planar(0.5, 0, 0, 0.5), "gps": planar(-0.5, 0, z=0.6)}.items():
        stamped = StampedTransform("base_link", name, 0, mount)
        tf.set_transform(stamped, "description", static=True)
    noise = np.random.default_rng(1)
    start_ns = time.time_ns()
    while not ended.wait(0.1):
        now_ns = time.time_ns()
        x, y = noise.normal((1.2e-9 * (now_ns - start_ns), 0), 0.02)
        pose = planar(x, y, noise.normal(0, 0.003))
        stamped = StampedTransform("map", "base_link", now_ns - 250_000_000, pose)
        tf.set_transform(stamped, "localiser")


def swing(tf: TransformClient, ended: threading.Event) -> None:
    """Six vehicles drive in circles, each with an arm: 30 moving frames."""
    for number in range(6):
        place = planar(number % 3 * 4, number // 3 * 4)
        stamped = StampedTransform("map", f"r{number}/odom", 0, place)
        tf.set_transform(stamped, "description", static=True)
    while not ended.wait(0.02):
        now_ns = time.time_ns()
        t = now_ns / 1e9
        rows = []
        for number in range(6):
            turn = 1.2 * t + number
            pose = planar(1.3 * math.cos(turn), 1.3 * math.sin(turn), turn + math.pi / 2)
            above = f"r{number}/odom"
            for at, part in enumerate(("base", "shoulder", "elbow", "wrist", "tool")):
                rows.append(StampedTransform(above, f"r{number}/{part}", now_ns, pose))
                above = f"r{number}/{part}"
                bend = 0.7 * math.sin(2 * t + at + number)
                pose = Transform.from_rpy(0, bend, 0, (0, 0, 0.5))
        tf.set_transforms_xact(rows, "arms")


@contextlib.contextmanager
def shown(page: Page, *args: object) -> Iterator[None]:
    """Open what `zenoh-tf view` shows."""
    command = [sys.executable, "-m", "zenoh_tf_tools", "view", *map(str, args)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        line = next(line for line in process.stdout if line.startswith("showing"))
        page.goto(line.split(" at ")[1].split()[0])
        page.get_by_text(" moving").first.wait_for(state="attached")
        page.wait_for_timeout(16_000)  # until it is drawn, with its names
        for note in page.locator(".mantine-Notification-closeButton").all():
            note.evaluate("button => button.click()")  # that there is no graphics processor
        yield
    finally:
        process.terminate()
        process.wait()


def choose(page: Page, label: str, value: str) -> None:
    """Choose an entry of a list in the panel."""
    page.get_by_label(label, exact=True).first.click(force=True)
    page.get_by_role("option", name=value, exact=True).first.click(force=True)


def press(page: Page, text: str) -> None:
    """Press a button, or open a tab, of the panel."""
    page.get_by_text(text, exact=True).first.click(force=True)
    page.wait_for_timeout(2000)


def slide(page: Page, label: str, value: float) -> None:
    """Set the number beside a slider of the panel."""
    number = page.locator(f"//label[text()='{label}']/following::input[@type='text'][1]")
    number.fill(str(value))
    number.press("Enter")


def photograph(page: Page, name: str) -> None:
    """Photograph the page for `save`."""
    page.wait_for_timeout(3000)
    save(Image.open(io.BytesIO(page.screenshot(timeout=120_000))), name)


def save(picture: Image.Image, name: str) -> None:
    """Write docs/figures/NAME, in 256 colours."""
    method = Image.Quantize.MAXCOVERAGE  # keeps colours that few pixels have, such as of axes
    colours = picture.convert("RGB").quantize(256, method, dither=Image.Dither.NONE)
    colours.save(FIGURES / name, optimize=True)
    print(FIGURES / name, flush=True)


def draw(page: Page, phone: Page, folder: Path) -> None:
    """Draw all pictures of the page, on a desk and on a phone."""
    wheels = "".join(WHEEL.format(x=x, y=y) for x in (-0.4, 0.4) for y in (-0.45, 0.45))
    cart = folder / "cart.urdf"
    cart.write_text(CART.format(wheels=wheels))
    robot(folder / "robot.mcap")
    shapes = ("--urdf", cart, "--urdf", ARM)
    with shown(page, folder / "robot.mcap", "--at", "+8s", *shapes):
        choose(page, "frame", "wrist")
        photograph(page, "view.png")
        press(page, "go to frame")
        photograph(page, "view-near.png")
    with shown(phone, folder / "robot.mcap", "--at", "+8s", *shapes):
        photograph(phone, "view-phone.png")
        press(phone, "zenoh-tf")
        photograph(phone, "view-phone-panel.png")
    robot(folder / "cup.mcap", cup=True, late_s=3.0)
    with shown(page, folder / "cup.mcap", "--at", "+8s", *shapes):
        press(page, "faults")
        photograph(page, "view-faults.png")
    with shown(page, folder / "cup.mcap", "--at", "+1s"):
        photograph(page, "view-not-yet.png")
    with serving(localise) as endpoint:
        live = ("--connect", endpoint, "--fixed", "map", "--trail", "3s", "--urdf", cart)
        with shown(page, *live):
            choose(page, "frame", "lidar")
            page.get_by_label("follow frame").first.click(force=True)
            page.get_by_text("the camera follows").wait_for()
            press(page, "go to frame")
            photograph(page, "view-estimate.png")
    with serving(swing) as endpoint, shown(page, "--connect", endpoint, "--trail", "2s"):
        page.wait_for_timeout(8000)
        photograph(page, "view-live.png")
        slide(page, "time [s]", -3.0)
        photograph(page, "view-paused.png")
    fleet(folder / "fleet.mcap")
    with shown(page, folder / "fleet.mcap", "--at", "+3s"):
        press(page, "frames")
        photograph(page, "view-frames.png")


def main() -> None:
    """Draw them in a browser of this machine."""
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if chromium is None:
        raise SystemExit("needs chromium")
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as folder:
        browser = playwright.chromium.launch(executable_path=chromium, args=SOFTWARE)
        window: Any = WINDOW
        page, phone = browser.new_page(viewport=window), browser.new_page(**PHONE)
        for each in (page, phone):
            each.set_default_timeout(120_000)
        draw(page, phone, Path(folder))
        browser.close()


if __name__ == "__main__":
    main()
