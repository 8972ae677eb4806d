"""Several cameras that are driven: each as it is alone, and as a live run has it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import clsim
from clsim.errors import Error, InputError
from clsim.live.options import LiveOptions
from clsim.live.rig import open_rig, run_all, seed_of
from clsim.scene.motion import compose, euler_quaternion, rotation_matrix
from clsim.scene.world import Mount

BASELINE = compose((0.15, 0.0, 0.0), np.eye(3))
MOUNTS = (Mount("left", np.eye(4)), Mount("right", BASELINE, resolution=(32, 20)))
END_US = 50_000
FPS = 60.0


def scene() -> clsim.World:
    return replace(clsim.load_scene("two-boxes", resolution=(48, 36)), rig=MOUNTS)


def poses(k: int) -> tuple[np.ndarray, np.ndarray]:
    """Of the rig and of the red box, at frame k."""
    rig = compose((-1.8 + 0.02 * k, 1.7, 3.4), rotation_matrix(euler_quaternion((-18.0, -27.0 + k, 0.0))))
    return rig, compose((-0.6, 0.55, -0.3), rotation_matrix(euler_quaternion((0.0, 4.0 * k, 0.0))))


def drive(simulator: clsim.Simulator | clsim.RigSimulator, placed: np.ndarray | None) -> list[object]:
    """Make steps; a camera that is alone stands where ``placed`` says on the rig."""
    found = []
    for k in range(5):
        rig, box = poses(k)
        simulator.set_camera(rig if placed is None else rig @ placed)
        simulator.set_pose("red box", box)
        found.append(simulator.step(1_000 * k))
    return found


@pytest.mark.slow
def test_each_camera_has_the_bits_that_it_has_alone() -> None:
    options = {"clock": "caller", "quality": "draft", "truth": ("depth", "flow"), "seed": 3}
    with clsim.RigSimulator(scene(), **options) as rig:
        assert list(rig.cameras) == ["left", "right"] and rig.cameras["right"].width == 32
        together = drive(rig, None)
        truths = {name: rig.truth(name) for name in rig.cameras}
        frames = {name: rig.frame(name).planes for name in rig.cameras}
        causes = rig.causes
    for number, mount in enumerate(MOUNTS):
        alone = replace(scene(), camera=replace(mount.camera(scene().camera), motion=scene().camera.motion), rig=())
        with clsim.Simulator(alone, **options | {"seed": seed_of(3, number)}) as simulator:
            expected = drive(simulator, mount.offset)
            assert sum(map(len, expected)) > 100
            assert [step[mount.name].tobytes() for step in together] == [events.tobytes() for events in expected]
            assert np.array_equal(simulator.frame().planes, frames[mount.name])
            assert np.array_equal(simulator.causes, causes[mount.name])
            for name, plane in simulator.truth().items():
                assert np.array_equal(plane, truths[mount.name][name], equal_nan=True), name


@pytest.mark.slow
def test_steps_have_the_bits_of_a_live_rig(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(
        "fps = 60\n[camera]\nresolution = [32, 24]\nlook_at = [0.0, 0.4, 0.0]\n"
        "keyframes = [{ time_s = 0.0, position = [-1.8, 1.7, 3.4] }, { time_s = 1.0, position = [0.2, 1.5, 3.6] }]\n"
        '[[cameras]]\nname = "left"\n[[cameras]]\nname = "right"\nposition = [0.2, 0.0, 0.0]\n'
        "[environment]\nradiance = [0.5, 0.5, 0.5]\n[materials.floor]\n"
        "checker = { color_a = [0.75, 0.72, 0.68], color_b = [0.16, 0.17, 0.2], squares_per_m = 2.5 }\n"
        '[[objects]]\nname = "floor"\nshape = "quad"\nsize = [12.0, 12.0]\nmaterial = "floor"\n'
    )
    outputs = (str(tmp_path / "{camera}.npz"),)
    sessions = open_rig(LiveOptions(str(path), frame_count=6, quality="draft", outputs=outputs))
    run_all(sessions)
    with clsim.RigSimulator(path, quality="draft") as rig:
        found = rig.step(sessions[0].schedule.time_us(5))
    assert list(found) == ["left", "right"]
    for name, events in found.items():
        assert len(events) > 100
        assert clsim.open(str(tmp_path / f"{name}.npz")).read().tobytes() == events.tobytes()


def test_a_rig_goes_back_and_restarts() -> None:
    with clsim.RigSimulator(scene(), fps=FPS, quality="draft") as rig:
        with pytest.raises(Error, match="there is no frame yet"):
            rig.frame("left")
        rig.step(END_US // 2)
        state = rig.snapshot()
        first = rig.step(END_US)
        rig.restore(state)
        second = rig.step(END_US)
        rig.reset()
        rig.step(END_US // 2)
        third = rig.step(END_US)
        for name, events in first.items():
            assert len(events) > 20
            assert events.tobytes() == second[name].tobytes() == third[name].tobytes()
        # Each has its own size, and its own place on the rig, which is where it was set.
        assert rig.frame("left").planes.shape[1:] == (36, 48) and rig.frame("right").planes.shape[1:] == (20, 32)
        placed, _ = poses(30)
        rig.set_camera(placed)
        rig.step(2 * END_US)
        for mount in MOUNTS:
            pose = rig.cameras[mount.name].motion.pose(rig.time_us * 1e-6)
            assert np.allclose(pose, placed @ mount.offset, atol=1e-6), mount.name
        with pytest.raises(InputError, match="before a reset"):
            rig.restore(state)
        with pytest.raises(InputError, match="left, right"):
            rig.truth("middle")


def test_a_rig_needs_cameras() -> None:
    with pytest.raises(InputError, match="two-boxes has one camera, expected a rig"):
        clsim.RigSimulator("two-boxes")


def test_a_rigs_scene_is_there_for_the_longest_exposure(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[tuple[object, ...]] = []
    monkeypatch.setattr("clsim.simulator.simulator.SceneData", lambda *args, **options: given.append(args))
    mounts = tuple(replace(mount, shutter_s=shutter_s) for mount, shutter_s in zip(MOUNTS, (0.004, 0.002), strict=True))
    with clsim.RigSimulator(replace(scene(), rig=mounts), fps=FPS, quality="draft", time="fixed") as rig:
        rig._scene_data()
    assert given[0][3] == 0.004


@pytest.mark.slow  # kernels of exposures are compiled
@pytest.mark.parametrize("shutters", [(0.0, 0.004), (0.004, 0.002)])
def test_cameras_may_expose_for_different_times(tmp_path: Path, shutters: tuple[float, float]) -> None:
    """The scene is there for the longest of them, whichever camera has it; where nothing moves no event fires."""
    path = tmp_path / "still.toml"
    path.write_text(
        "[camera]\nresolution = [32, 24]\nposition = [0.0, 1.5, 3.6]\nlook_at = [0.0, 0.4, 0.0]\n"
        "[environment]\nradiance = [0.5, 0.5, 0.5]\n[materials.floor]\n"
        "checker = { color_a = [0.75, 0.72, 0.68], color_b = [0.16, 0.17, 0.2], squares_per_m = 2.5 }\n"
        '[[objects]]\nname = "floor"\nshape = "quad"\nsize = [12.0, 12.0]\nmaterial = "floor"\n'
    )
    still = clsim.load_scene(path)
    mounts = tuple(replace(mount, shutter_s=shutter_s) for mount, shutter_s in zip(MOUNTS, shutters, strict=True))
    with clsim.RigSimulator(replace(still, rig=mounts), fps=FPS, quality="draft") as rig:
        assert {name: len(events) for name, events in rig.step(END_US).items()} == {"left": 0, "right": 0}
        assert all(rig.frame(name).planes.any() for name in rig.cameras)


@pytest.mark.slow
def test_a_camera_that_exposes_longer_than_the_others_blurs_as_it_does_alone(tmp_path: Path) -> None:
    """A box goes by: its picture in the camera that exposes is that of this camera on its own, driven and live."""
    path = tmp_path / "rig.toml"
    text = (
        "fps = 30\n[camera]\nresolution = [32, 24]\nposition = [0.0, 0.4, 3.0]\nSHUTTER\nCAMERAS"
        "[environment]\nradiance = [0.5, 0.5, 0.5]\n[materials.dark]\ncolor = [0.05, 0.05, 0.05]\n"
        '[[objects]]\nname = "box"\nshape = "box"\nsize = [0.5, 0.5, 0.5]\nmaterial = "dark"\n'
        "keyframes = [{ time_s = 0.0, position = [-1.5, 0.4, 0.0] }, { time_s = 0.2, position = [1.5, 0.4, 0.0] }]\n"
    )
    path.write_text(text.replace("SHUTTER", "shutter_s = 0.03").replace("CAMERAS", ""))
    options = {"quality": "draft", "seed": 2}
    with clsim.Simulator(path, **options | {"seed": seed_of(2, 1)}) as alone:
        expected = alone.step(100_000)
        picture = alone.frame().planes
    mounts = '[[cameras]]\nname = "sharp"\n[[cameras]]\nname = "blurred"\nshutter_s = 0.03\n'
    path.write_text(text.replace("SHUTTER", "").replace("CAMERAS", mounts))
    with clsim.RigSimulator(path, **options) as rig:
        driven = rig.step(100_000)["blurred"]
        # Where a camera on a rig stands is a product of poses, rounded.
        np.testing.assert_allclose(rig.frame("blurred").planes, picture, rtol=1e-5, atol=1e-6)
        assert np.abs(rig.frame("sharp").planes - picture).max() > 0.1
    sessions = open_rig(LiveOptions(str(path), frame_count=4, outputs=(str(tmp_path / "{camera}.npz"),), **options))
    run_all(sessions)
    live = clsim.open(str(tmp_path / "blurred.npz")).read()
    assert driven.tobytes() == live.tobytes() and len(expected) > 50
    assert abs(len(driven) - len(expected)) <= 2
