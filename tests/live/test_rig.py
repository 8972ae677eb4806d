"""Several cameras on a rig: where they are, and that each is as if it were alone, with noise of its own."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

import clsim
from clsim.cli.output import rig as rig_output
from clsim.cli.output.rig import run_rig
from clsim.cli.output.status import INTERRUPTED, OUTPUT_FAILED
from clsim.errors import InputError
from clsim.events import SinkError
from clsim.live import rig as live_rig
from clsim.live import session as live_session
from clsim.live.options import LiveOptions
from clsim.live.rig import extrinsics, open_rig, run_all, seed_of

RIG = """
fps = 120
[camera]
resolution = [32, 24]
look_at = [0.0, 0.4, 0.0]
keyframes = [{ time_s = 0.0, position = [-1.8, 1.7, 3.4] }, { time_s = 1.0, position = [0.2, 1.5, 3.6] }]
[[cameras]]
name = "left"
[[cameras]]
name = "right"
position = [0.2, 0.0, 0.0]
MORE
[environment]
radiance = [0.5, 0.5, 0.5]
[materials.floor]
checker = { color_a = [0.75, 0.72, 0.68], color_b = [0.16, 0.17, 0.2], squares_per_m = 2.5 }
[[objects]]
name = "floor"
shape = "quad"
size = [12.0, 12.0]
material = "floor"
"""


def rig(folder: Path, more: str = "") -> str:
    path = folder / "rig.toml"
    path.write_text(RIG.replace("MORE", more))
    return str(path)


def test_extrinsics_lead_from_one_camera_to_the_other(tmp_path: Path) -> None:
    turned = "rotation_deg = [5.0, -20.0, 3.0]\nresolution = [40, 20]\nfov_deg = 70.0"
    world = clsim.load_scene(rig(tmp_path, turned))
    left, right = world.rig
    cameras = [mount.camera(world.camera) for mount in (left, right)]
    assert (cameras[0].width, cameras[0].fov_deg) == (32, 50.0) and (cameras[1].width, cameras[1].fov_deg) == (40, 70.0)
    axes = np.diag((1.0, -1.0, -1.0, 1.0))
    point = np.array([0.3, -0.2, 0.5, 1.0])
    for time_s in (0.0, 0.4):
        seen = [axes @ np.linalg.inv(camera.motion.pose(time_s)) @ point for camera in cameras]
        assert np.allclose(np.array(extrinsics(left, world.rig)["right"]) @ seen[0], seen[1])
        assert np.allclose(np.array(extrinsics(right, world.rig)["left"]) @ seen[1], seen[0])


def test_what_cannot_be_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a\.npz: is a file for each of the cameras left, right; expected {camera}"):
        open_rig(LiveOptions(rig(tmp_path), outputs=("a.npz",)))
    with pytest.raises(InputError, match="cameras: 'left' is the name of 2 cameras"):
        clsim.load_scene(rig(tmp_path, '[[cameras]]\nname = "left"'))
    with pytest.raises(InputError, match=r"cameras\[2\]\.name"):
        clsim.load_scene(rig(tmp_path, '[[cameras]]\nname = "../up"'))


@pytest.mark.slow  # kernels of exposures are compiled
@pytest.mark.parametrize("shutters", [(0.0, 0.004), (0.004, 0.002)])
def test_cameras_of_a_rig_may_expose_for_different_times(tmp_path: Path, shutters: tuple[float, float]) -> None:
    """The scene is there for the longest of them, whichever camera has it; where nothing moves no event fires."""
    lines = RIG.replace('"left"', f'"left"\nshutter_s = {shutters[0]}').replace("MORE", f"shutter_s = {shutters[1]}")
    still = ("position = [0.2, 1.5, 3.6]" if line.startswith("keyframes") else line for line in lines.splitlines())
    scene = tmp_path / "rig.toml"
    scene.write_text("\n".join(still))
    sessions = open_rig(LiveOptions(str(scene), frame_count=3, quality="draft"))
    run_all(sessions)
    assert [session.summary().frames for session in sessions] == [3, 3]
    assert [session.summary().events for session in sessions] == [0, 0]


@pytest.mark.slow
def test_each_camera_has_a_sensor_and_an_imu_of_its_own(tmp_path: Path) -> None:
    """Noise that two cameras share, to the microsecond, would be depth without end to who compares them."""
    noise = tmp_path / "imu.yaml"
    noise.write_text(
        "accelerometer_noise_density: 0.02\naccelerometer_random_walk: 0.001\n"
        "gyroscope_noise_density: 0.01\ngyroscope_random_walk: 0.0001\n"
    )
    dark = Path(rig(tmp_path)).read_text().replace("radiance = [0.5, 0.5, 0.5]", "radiance = [0.005, 0.005, 0.005]")
    scene = tmp_path / "dark.toml"
    scene.write_text(dark)
    options = LiveOptions(
        str(scene), frame_count=24, quality="draft", sensor="davis346", truth=("imu",), imu_noise=str(noise),
        outputs=(str(tmp_path / "{camera}.h5"),),
    )  # fmt: skip
    run_all(open_rig(options))
    left, right = (clsim.open(str(tmp_path / f"{name}.h5")).read() for name in ("left", "right"))
    assert len(left) > 20 and len(right) > 20
    assert len(set(left.tolist()) & set(right.tolist())) < 0.1 * len(left)
    shaken = []
    for name in ("left", "right"):
        with h5py.File(tmp_path / f"{name}.h5") as file:
            shaken.append(np.diff(file["imu/acceleration"][:], axis=0).ravel())
            assert json.loads(file.attrs["about"])["options"]["seed"] == 0
    assert abs(np.corrcoef(shaken)[0, 1]) < 0.2


@pytest.mark.slow
def test_each_camera_is_as_if_it_were_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its events, its truth, and what is told of their noise, for which all pixels are sampled twice."""
    monkeypatch.setattr(live_session, "DUPLICATE_EVERY", 1)
    scene = rig(tmp_path)
    outputs = (str(tmp_path / "{camera}.h5"),)
    options = LiveOptions(scene, frame_count=6, quality="draft", truth=("depth",), outputs=outputs)
    sessions = open_rig(options)
    run_all(sessions)
    world = clsim.load_scene(scene)
    told = [session.summary().noise_share for session in sessions]
    assert all(0.0 < share < 0.3 for share in told if share is not None) and None not in told and told[0] != told[1]
    for number, mount in enumerate(world.rig):
        alone = replace(world, camera=mount.camera(world.camera), rig=())
        with clsim.Simulator(alone, quality="draft", truth=("depth",), seed=seed_of(0, number)) as simulator:
            expected = simulator.step(sessions[0].schedule.time_us(5))
            depth = simulator.truth("depth")["depth"]
        assert len(expected) > 100
        assert clsim.open(str(tmp_path / f"{mount.name}.h5")).read().tobytes() == expected.tobytes()
        with h5py.File(tmp_path / f"{mount.name}.h5") as file:
            assert np.array_equal(file["frames/depth"][5], depth) and file.attrs["camera_name"] == mount.name
    with h5py.File(tmp_path / "left.h5") as left, h5py.File(tmp_path / "right.h5") as right:
        near, far = left["frames/depth"][5], right["frames/depth"][5]
    # What both see lies at the same depth, to the left in the right picture by focal length × baseline ÷ depth.
    shift = 16 / np.tan(np.radians(25)) * 0.2 / near
    y, x = np.mgrid[:24, :32]
    at = np.floor(x - shift).clip(0, 30).astype(int)
    share = x - shift - at
    seen = np.isfinite(near) & (share >= 0) & (share < 1) & np.isfinite(far[y, at]) & np.isfinite(far[y, at + 1])
    assert seen.sum() > 100
    # On a plane, 1 / depth goes linearly from pixel to pixel.
    inverse = (1 - share) / far[y, at] + share / far[y, at + 1]
    assert np.abs(inverse * near - 1)[seen].max() < 1e-5


def test_one_that_fails_ends_those_that_would_run_for_ever(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sessions = open_rig(LiveOptions(rig(tmp_path), quality="draft", loop=True))
    endless, failing = (session.pipeline for session in sessions)
    asked = []

    def fail(timeout_s: float) -> bool:
        raise InputError("no such light")

    monkeypatch.setattr(failing, "wait", fail)
    monkeypatch.setattr(endless, "wait", lambda timeout_s: asked.append(timeout_s) or len(asked) > 20)
    for session in sessions:
        monkeypatch.setattr(session.pipeline, "start", lambda: None)
    with pytest.raises(InputError, match="no such light"):
        run_all(sessions)
    assert len(asked) == 1


@pytest.mark.parametrize(("ends", "status"), [(KeyboardInterrupt(), INTERRUPTED), (SinkError("full"), OUTPUT_FAILED)])
def test_a_rigs_summaries_say_whether_it_was_interrupted(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    ends: BaseException,
    status: int,
) -> None:
    def run(sessions: object) -> None:
        raise ends

    lost: list[object] = []
    monkeypatch.setattr(rig_output, "print_losses", lambda console, summary: lost.append(summary))
    monkeypatch.setattr(live_rig, "run_all", run)
    sessions = open_rig(LiveOptions(rig(tmp_path, "resolution = [40, 30]"), quality="draft"))
    assert run_rig(sessions, as_json=True) == status
    summaries = json.loads(capsys.readouterr().out)
    assert [each["interrupted"] for each in summaries] == [status == INTERRUPTED] * 2
    assert len(lost) == 2, "what was lost is told beside figures too"
    assert [(each["width"], each["height"]) for each in summaries] == [(32, 24), (40, 30)]


def test_no_two_cameras_of_runs_with_small_seeds_share_their_noise() -> None:
    seeds = [seed_of(seed, number) for seed in range(50) for number in range(8)]
    assert len(set(seeds)) == 400 and max(seeds) < 2**64 and [seed_of(seed, 0) for seed in range(50)] == [*range(50)]
    assert min(set(seeds) - {*range(50)}) > 2**32
