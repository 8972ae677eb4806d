"""Sidecars of a run's files: how it was made, and where the camera was."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import Any

import numpy as np

from clsim.detect.config import DetectorConfig
from clsim.errors import InputError
from clsim.live.pacing.schedule import Schedule
from clsim.scene import Camera, bundled_names
from clsim.scene.motion import Matrix
from clsim.scene.rigid import quaternion_of, without_scale
from clsim.sensor.settings import SensorSettings
from clsim.version import VERSION

_HEAD = """\
# Poses of the camera in the world, a line a frame, in the TUM format: time_s x y z qx qy qz qw
# metres; the camera's +x is right, +y down, +z ahead (OpenCV's axes); the world is right-handed
"""
_DISTORTION = {"perspective": ("k1", "k2", "p1", "p2", "k3"), "fisheye": ("k1", "k2", "k3", "k4")}


def about_run(
    options: dict[str, Any], config: DetectorConfig, fps: float, sensor: SensorSettings | None = None
) -> dict[str, Any]:
    """Return what a sidecar tells of any run; a scene file by its full path, so that it is found from any folder."""
    scene = options.get("scene")
    if scene is not None and scene not in bundled_names():
        options = options | {"scene": os.path.abspath(scene)}
    for name in ("camera_path", "frames", "times"):
        if isinstance(options.get(name), str):
            options = options | {name: os.path.abspath(options[name])}
    pattern = None if sensor is None else sensor.optics.color_filter
    return ({} if pattern is None else {"color_filter": pattern}) | {
        "clsim_version": VERSION,
        "options": options,
        "thresholds": {"on": config.threshold_on, "off": config.threshold_off},
        "fps": fps,
    }


def scene_from_here(about: dict[str, Any], folder: Path) -> dict[str, str]:
    """Return the path of a run's scene file from the sidecar's folder, for the two may move together."""
    scene = about["options"].get("scene")
    if scene is not None and os.path.isabs(scene):
        with contextlib.suppress(ValueError):  # Windows: no path leads from one drive to another
            return {"scene_from_here": os.path.relpath(os.path.realpath(scene), os.path.realpath(folder))}
    return {}


def about_camera(camera: Camera) -> dict[str, Any]:
    """Return a camera's size, lens and intrinsics [pixels], as OpenCV defines them for its model.

    The first pixel's corner is at 0, 0 and its centre at 0.5, 0.5; for OpenCV's own functions take 0.5 off ``cx`` and
    ``cy``. The model ``fisheye`` is OpenCV's (equidistant); a focal length is that without distortion, and
    ``fx`` is negative where the image is mirrored. An orthographic camera has no intrinsics in that sense: it has the
    width of what it sees [m], pixels per metre, and the pixel of its axis.
    """
    lens, width = camera.lens, camera.width
    fx, fy = camera.focal_px()
    cx, cy = width * (0.5 + lens.principal_point[0]), camera.height / 2.0 + width * lens.principal_point[1]
    if lens.model == "orthographic":
        return {
            "width": width,
            "height": camera.height,
            "view_width_m": lens.view_width_m,
            "model": lens.model,
            "pixels_per_m": {"x": fx, "y": fy},
            "axis_px": {"cx": cx, "cy": cy},
        }
    names = _DISTORTION[lens.model]
    return {
        "width": width,
        "height": camera.height,
        "fov_deg": camera.fov_deg,
        "model": lens.model,
        "intrinsics_px": {"fx": fx, "fy": fy, "cx": cx, "cy": cy},
        "distortion": dict.fromkeys(names, 0.0) | dict(zip(names, lens.distortion, strict=False)),
    }


def camera_pose(camera: Camera, time_s: float) -> Matrix:
    """Return the camera-to-world matrix ``[4, 4]`` at a time; the camera looks along −z, with +y up."""
    return without_scale(camera.motion.pose(time_s))


def poses_path(output: str | Path) -> Path:
    """Return where the poses of an event file go."""
    return Path(f"{output}.poses.txt")


class PoseFile:
    """A line a frame, written as the run goes: a kill loses none, and memory holds none."""

    def __init__(self, path: Path, camera: Camera, schedule: Schedule) -> None:
        """Create the file; raises InputError when it cannot be."""
        self._camera, self._schedule = camera, schedule
        try:
            self._file = path.open("w", encoding="utf-8", buffering=1)
            self._file.write(_HEAD)
        except OSError as error:
            raise InputError(f"{path}: cannot be written ({error.strerror or error})") from None

    def add(self, index: int) -> None:
        """Write the pose of frame ``index`` of the run, at the run's own time; raises OSError when the disk is full."""
        schedule = self._schedule
        matrix = camera_pose(self._camera, schedule.time_us(schedule.source_index(index)) * 1e-6)
        place = " ".join(f"{value:.9g}" for value in matrix[:3, 3])
        turn = " ".join(f"{value:.9f}" for value in quaternion_of(matrix[:3, :3] @ np.diag((1.0, -1.0, -1.0))))
        self._file.write(f"{schedule.time_us(index) * 1e-6:.6f} {place} {turn}\n")

    def close(self) -> None:
        """Complete the file; safe to call twice."""
        self._file.close()
