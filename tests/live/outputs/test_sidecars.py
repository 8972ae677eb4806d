"""Where the camera was, and what its lens does, beside the events."""

import math
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from clsim.detect.config import DetectorConfig
from clsim.errors import InputError
from clsim.events.sidecar import write_sidecar
from clsim.frames import Frame
from clsim.live.outputs.sidecars import PoseFile, about_camera, about_run, camera_pose
from clsim.live.pacing.schedule import Schedule
from clsim.render import PathTracer, RenderOptions
from clsim.scene import Camera, World, load_world
from clsim.scene.motion import Static
from clsim.scene.trajectories.trajectory import read_tum
from clsim.scene.world import Lens, SphereLight
from tests.shared_kernels import LIGHTS, widen

LENSES = {
    "pinhole": Lens(),
    "off-centre": Lens(principal_point=(0.06, -0.04)),
    "distorted": Lens(distortion=(-0.25, 0.08, 0.01, -0.02, 0.03), principal_point=(-0.03, 0.02)),
    "fisheye": Lens(model="fisheye", distortion=(0.05, -0.02, 0.01, -0.003), principal_point=(0.05, 0.03)),
}
"""Brown and Conrady's model and Kannala and Brandt's, as OpenCV's calib3d defines them."""


def projected(about: dict, x: float, y: float, z: float) -> tuple[float, float]:
    """Return where OpenCV's model of a sidecar sees a point: x right, y down, z ahead."""
    px, k = about["intrinsics_px"], about["distortion"]
    a, b = x / z, y / z
    if about["model"] == "fisheye":
        r = math.hypot(a, b)
        t = math.atan(r)
        scale = t * (1 + k["k1"] * t**2 + k["k2"] * t**4 + k["k3"] * t**6 + k["k4"] * t**8) / r
        a, b = a * scale, b * scale
    else:
        r2 = a * a + b * b
        radial = 1 + k["k1"] * r2 + k["k2"] * r2**2 + k["k3"] * r2**3
        a, b = (
            a * radial + 2 * k["p1"] * a * b + k["p2"] * (r2 + 2 * a * a),
            b * radial + k["p1"] * (r2 + 2 * b * b) + 2 * k["p2"] * a * b,
        )
    return px["fx"] * a + px["cx"], px["fy"] * b + px["cy"]


@pytest.mark.parametrize("name", LENSES)
def test_the_intrinsics_say_where_the_renderer_sees_a_point(
    name: str, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    widen(monkeypatch, request, LIGHTS)  # as in tests of lenses
    width, height = 96, 72
    place = (0.9, -0.5, 3.0)
    camera = Camera(width, height, 70.0, Static(np.eye(4)), lens=LENSES[name])
    lamp = SphereLight(radius_m=0.06, radiance=(1.0, 1.0, 1.0), motion=Static(moved(place[0], -place[1], -place[2])))
    world = World("lamp", camera, sphere_lights=(lamp,))
    tracer = PathTracer(world, RenderOptions(spp=16, variances=True))
    frame = Frame(np.zeros((len(tracer.names), height, width), np.float32), tracer.names)
    tracer.fill(0, frame)
    tracer.close()
    light = frame.plane("R").astype(float)
    assert light.sum() > 5
    rows, columns = np.mgrid[:height, :width] + 0.5
    seen = (light * columns).sum() / light.sum(), (light * rows).sum() / light.sum()
    np.testing.assert_allclose(seen, projected(about_camera(camera), *place), atol=0.1)


def moved(x: float, y: float, z: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def test_poses_are_written_as_the_run_goes_and_read_back_as_a_trajectory(tmp_path: Path) -> None:
    camera = load_world("two-boxes").camera
    schedule = Schedule(50.0, 5, None, loop=True)
    path = tmp_path / "a.npz.poses.txt"
    poses = PoseFile(path, camera, schedule)
    for index in (0, 1, 2, 4, 6, 7):
        poses.add(index)
        lines = path.read_text().splitlines()
        assert lines[-1].split()[0] == f"{index / 50:.6f}", "a kill must lose none"
    poses.close()
    poses.close()
    assert lines[0].startswith("#") and len(lines) == 2 + 6
    read = read_tum(path)
    for index in (0, 1, 2, 4, 6, 7):
        shown_s = (index % 5) / 50
        np.testing.assert_allclose(read.pose(index / 50), camera.motion.pose(shown_s), atol=1e-6)


def test_a_scaled_camera_has_a_pose_without_scale() -> None:
    scaled = Static(np.diag([2.0, 2.0, 2.0, 1.0]) @ moved(1.0, 2.0, 3.0))
    pose = camera_pose(replace(load_world("still").camera, motion=scaled), 0.0)
    np.testing.assert_allclose(pose[:3, :3], np.eye(3), atol=1e-12)


def test_an_orthographic_camera_is_told_in_metres() -> None:
    lens = Lens(model="orthographic", view_width_m=4.0, principal_point=(0.25, 0.0), mirrored=True)
    told = about_camera(Camera(80, 60, 45.0, Static(np.eye(4)), lens=lens))
    assert told == {
        "width": 80,
        "height": 60,
        "view_width_m": 4.0,
        "model": "orthographic",
        "pixels_per_m": {"x": -20.0, "y": 20.0},
        "axis_px": {"cx": 60.0, "cy": 30.0},
    }


def test_a_sidecar_that_cannot_be_written_leaves_nothing_behind(tmp_path: Path) -> None:
    (tmp_path / "a.json").mkdir()
    with pytest.raises(InputError, match=r"a\.json"):
        write_sidecar(tmp_path / "a.json", {"format": "none"})
    assert [path.name for path in tmp_path.iterdir()] == ["a.json"]


def test_files_that_a_run_read_are_found_from_any_folder() -> None:
    """A scene that comes with clsim, and what was not given, stay as they are."""
    given = {"scene": "mine.toml", "camera_path": "a/b.txt", "frames": "film.mp4", "times": "times.txt", "sensor": None}
    told = about_run(given, DetectorConfig(), 30.0)["options"]
    assert told == {name: value and os.path.abspath(value) for name, value in given.items()}
    plain = {"scene": "two-boxes", "camera_path": None, "frames": None}
    assert about_run(plain, DetectorConfig(), 30.0)["options"] == plain
