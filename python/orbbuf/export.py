# SPDX-License-Identifier: Apache-2.0
"""Sessions in the layouts of data sets: docs/datasets.md, "Export to another layout", has a table of them.

Each function makes the folder `out`, whose images are hard links to the session's where the file system allows it,
else copies, and returns what the layout could not hold, a sentence each.
"""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass
from pathlib import Path

from .frame import Frame
from .session import PathLike, Session, format_seconds

# Name in camera.txt: how many numbers it has, and EuRoC's name (Kalibr's words).
_MODELS = {
    "Pinhole": (5, "radial-tangential"),
    "RadTan": (8, "radial-tangential"),
    "FOV": (5, "fov"),
    "EquiDistant": (8, "equidistant"),
    "KannalaBrandt": (8, "equidistant"),
}


@dataclass(frozen=True)
class Camera:
    """DSO's camera.txt: lengths in pixels, the middle of the first pixel is 0."""

    model: str  #: Pinhole, RadTan, FOV, EquiDistant or KannalaBrandt
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...]
    width: int
    height: int
    baseline_m: float = 0.0  #: from the left camera to the right one; 0: not known


def parse_camera(text: str) -> Camera:
    """Reads camera.txt; ValueError if it is none."""
    lines = [line.split() for line in text.split("\n")]
    if len(lines) < 4:
        raise ValueError("camera.txt: expected DSO's four lines")
    has_name = bool(lines[0]) and lines[0][0] in _MODELS
    numbers = [float(word) for word in lines[0][has_name:]]
    if has_name:
        model = lines[0][0]
    else:  # DSO's older files
        model = "RadTan" if len(numbers) == 8 else "Pinhole" if numbers[4:5] == [0] else "FOV"
    if len(numbers) != _MODELS[model][0] or min(numbers[:2]) <= 0:
        raise ValueError("camera.txt: expected Pinhole or FOV and 5 numbers, or RadTan, EquiDistant or KannalaBrandt and 8")
    width, height = (int(word) for word in lines[1])
    fx, fy, cx, cy = numbers[:4]
    if cx < 1 and cy < 1:  # DSO's rule, and its half a pixel: relative numbers count from the image's edge
        fx, fy, cx, cy = fx * width, fy * height, cx * width - 0.5, cy * height - 0.5
    baseline = float(lines[4][0]) if len(lines) > 4 and len(lines[4]) == 1 else 0.0
    return Camera(model, fx, fy, cx, cy, () if model == "Pinhole" else tuple(numbers[4:]), width, height, baseline)


class _Output:
    """A data set that is being made."""

    def __init__(self, session: Session, out: PathLike) -> None:
        self.folder = Path(out)
        if self.folder.exists() and any(self.folder.iterdir()):
            raise FileExistsError(f"{out}: not empty; this makes a new folder")
        if not len(session):
            raise ValueError(f"{session.folder}: no frames")
        self.session = session
        self.notes: list[str] = []
        self._offset_ns = session.clock_offset_ns
        if self._offset_ns:
            self.notes.append(f"the robot's clock was set: all times have {self._offset_ns * 1e-9:+.3f} s added")
        self.camera = None
        if session.camera is None:
            self.notes.append("no calibration: the robot sent none")
        else:
            try:
                self.camera = parse_camera(session.camera)
            except ValueError as error:
                self.notes.append(f"no calibration: {error}")

        kalibr = session.folder / "camchain-imucam.yaml"
        if kalibr.exists():
            self.text(kalibr.name, kalibr.read_text())
            self.notes.append(f"{kalibr.name} is copied; orbbuf-server export also writes what it has beyond camera.txt")

    def time_ns(self, frame: Frame) -> int:
        return frame.time_ns + self._offset_ns

    def samples(self, source: Path, name: str) -> None:
        head, *lines = source.read_text().splitlines(keepends=True)
        times = (line.split(",", 1) for line in lines)
        self.text(name, head + "".join(f"{int(time) + self._offset_ns},{rest}" for time, rest in times))

    def text(self, name: str, content: str) -> None:
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)

    def image(self, source: object, name: str) -> None:
        assert isinstance(source, Path)
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            os.link(source, path)
        except FileNotFoundError:
            raise
        except OSError:
            shutil.copyfile(source, path)


def to_tum(session: Session, out: PathLike) -> list[str]:
    """TUM RGB-D: rgb.txt and rgb/SECONDS.jpg."""
    output = _Output(session, out)
    index = "# color images\n# by orbbuf\n# timestamp filename\n"
    for frame in session:
        time = format_seconds(output.time_ns(frame))
        output.image(frame.left, f"rgb/{time}.jpg")
        index += f"{time} rgb/{time}.jpg\n"
    output.text("rgb.txt", index)
    if session.is_stereo:
        output.notes.append("TUM RGB-D has one camera: the right images are left out")
    if session.camera is not None:
        output.notes.append("TUM RGB-D has no file for a calibration: it is left out")
    return output.notes


def to_kitti(session: Session, out: PathLike) -> list[str]:
    """KITTI: image_0/000000.jpg, renumbered, image_1 of the right camera, times.txt, calib.txt."""
    output = _Output(session, out)
    digits = 9 if session[-1].sequence > 999_999 else 6
    for number, frame in enumerate(session):
        output.image(frame.left, f"image_0/{number:0{digits}}.jpg")
        if frame.right is not None:
            output.image(frame.right, f"image_1/{number:0{digits}}.jpg")
    output.text("times.txt", "".join(f"{format_seconds(output.time_ns(frame))}\n" for frame in session))
    camera = output.camera
    if camera is None:
        return output.notes
    if camera.model != "Pinhole":
        output.notes.append(f"no calib.txt: KITTI's knows no lens distortion, and the camera is {camera.model}")
        return output.notes
    calib = "P0: " + _projection(camera, 0)
    if session.is_stereo and camera.baseline_m:
        calib += "P1: " + _projection(camera, camera.baseline_m)
    elif session.is_stereo:
        output.notes.append("no P1 in calib.txt: the calibration is of no rectified pair")
    output.text("calib.txt", calib)
    return output.notes


def _projection(camera: Camera, x_m: float) -> str:
    """A row-major 3x4 matrix: the camera at x_m to the right."""
    shift = f"{-camera.fx * x_m:.12e}" if x_m else "0"
    return f"{camera.fx:.12e} 0 {camera.cx:.12e} {shift} 0 {camera.fy:.12e} {camera.cy:.12e} 0 0 0 1 0\n"


def to_euroc(session: Session, out: PathLike) -> list[str]:
    """EuRoC: mav0/cam0/data/NANOSECONDS.jpg, data.csv and sensor.yaml, cam1 of the right camera, imu0/data.csv."""
    output = _Output(session, out)
    index = "#timestamp [ns],filename\n"
    for frame in session:
        time_ns = f"{output.time_ns(frame):019}"
        output.image(frame.left, f"mav0/cam0/data/{time_ns}.jpg")
        if frame.right is not None:
            output.image(frame.right, f"mav0/cam1/data/{time_ns}.jpg")
        index += f"{time_ns},{time_ns}.jpg\n"
    for camera in ("cam0", "cam1") if session.is_stereo else ("cam0",):
        output.text(f"mav0/{camera}/data.csv", index)
    for samples in session.folder.glob("imu*/data.csv"):
        output.samples(samples, f"mav0/{samples.parent.name}/data.csv")
    if output.camera is None:
        return output.notes
    output.text("mav0/cam0/sensor.yaml", _sensor_yaml(output.camera, session.rate_hz, 0.0))
    if session.is_stereo and output.camera.baseline_m:
        output.text("mav0/cam1/sensor.yaml", _sensor_yaml(output.camera, session.rate_hz, output.camera.baseline_m))
    elif session.is_stereo:
        output.notes.append("no cam1/sensor.yaml: the calibration has no right camera")
    return output.notes


def _sensor_yaml(camera: Camera, rate_hz: float, x_m: float) -> str:
    rate = f"rate_hz: {rate_hz:.3f}\n" if rate_hz else ""
    return f"""sensor_type: camera
comment: by orbbuf
T_BS:
  cols: 4
  rows: 4
  data: [1.0, 0.0, 0.0, {x_m},
         0.0, 1.0, 0.0, 0.0,
         0.0, 0.0, 1.0, 0.0,
         0.0, 0.0, 0.0, 1.0]
{rate}resolution: [{camera.width}, {camera.height}]
camera_model: pinhole
intrinsics: [{camera.fx}, {camera.fy}, {camera.cx}, {camera.cy}]
distortion_model: {_MODELS[camera.model][1]}
distortion_coefficients: [{', '.join(str(number) for number in camera.distortion or (0.0, 0.0, 0.0, 0.0))}]
"""
