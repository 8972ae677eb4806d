"""What is set from outside: poses, light, and the clock."""

import time
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import clsim
from clsim.errors import Error, InputError
from clsim.render import SceneData
from clsim.render.accel.placement import place
from clsim.scene import Camera, Material, load_world
from clsim.scene.driven import Driven, place_of, placed
from clsim.scene.motion import Static, compose, look_at, rotation_matrix
from clsim.scene.shapes import box
from clsim.simulator.driving import Driving
from clsim.simulator.stepping import StepClock
from tests.simulator.stage import KEYS, keyframed, scene, simulator

POSES = {round(t * 1e6): (position, quaternion) for t, position, quaternion in KEYS}


def test_the_same_keyframes_by_hand_and_by_file_give_the_same_bits(tmp_path: Path) -> None:
    """Nobody knows how fast what is driven will be, so it is not followed between frames unless that is asked for."""
    with clsim.Simulator(scene(tmp_path, keyframed()), time="fixed") as by_file:
        expected = by_file.step(40_000)
    assert len(expected) > 200
    with clsim.Simulator(scene(tmp_path)) as by_hand:
        for at_us, pose in POSES.items():
            by_hand.set_pose("box", pose, at_us)
        assert by_hand.step(40_000).tobytes() == expected.tobytes()
        by_hand.reset()
        by_hand.set_pose("box", POSES[0])
        parts = [by_hand.step(0)]
        for at_us in (12_000, 30_000, 40_000):
            by_hand.set_pose("box", compose(POSES[at_us][0], rotation_matrix(POSES[at_us][1])))
            parts.append(by_hand.step(at_us))
    assert np.concatenate(parts).tobytes() == expected.tobytes()


@pytest.mark.slow
def test_pixels_traced_between_frames_are_driven_too(tmp_path: Path) -> None:
    options: dict[str, Any] = {"time": "adaptive", "fps": 200.0}
    with clsim.stream(scene(tmp_path, keyframed()), frame_count=9, **options) as live:
        expected = np.concatenate(list(live)).tobytes()
    with clsim.Simulator(scene(tmp_path, keyframed()), clock="caller", **options) as by_file:
        assert b"".join(by_file.step(until_us).tobytes() for until_us in range(0, 40_001, 5_000)) == expected
    with clsim.Simulator(scene(tmp_path), **options) as by_hand:
        parts = []
        for at_us, pose in POSES.items():
            by_hand.set_pose("box", pose)
            parts.append(by_hand.step(at_us).tobytes())
    assert b"".join(parts) == expected and len(expected) > 10_000


def test_poses_of_the_whole_exposure_are_kept(tmp_path: Path) -> None:
    """A frame that exposes for longer than a step needs poses of steps before."""
    world = load_world(str(scene(tmp_path)))
    world = replace(world, camera=replace(world.camera, shutter_s=0.01))
    driving = Driving(world)
    for k in range(30):
        driving.set_place("box", ((0.1 * k, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), 1.0), 1000 * k, None)
    driving.forget_before(20_000)
    for time_us in (10_000, 15_500, 20_000, 29_000):
        assert driving.pose("box", time_us)[0, 3] == pytest.approx(1e-4 * time_us)
    assert driving.pose("box", 8_000)[0, 3] == pytest.approx(1.0), "older ones are let go"


@pytest.mark.parametrize("shutter_s", [0.0, 0.01])
def test_a_camera_that_has_exposed_at_rest_stays_where_it_is(tmp_path: Path, shutter_s: float) -> None:
    world = load_world(str(scene(tmp_path)))
    driving = Driving(replace(world, camera=replace(world.camera, shutter_s=shutter_s)))
    driving.seal()
    with pytest.raises(InputError, match="camera stands still in") if shutter_s else nullcontext():
        driving.set_place("camera", ((0.0, 0.4, 2.0), (0.0, 0.0, 0.0, 1.0), 1.0), 1000, 0)


def test_poses_turn_by_slerp_and_grow_evenly() -> None:
    driven = Driven(Static(np.eye(4)))
    assert driven.duration_s > 0, "or it would be baked"
    for time_s, degrees, scale in ((1.0, 0.0, 1.0), (3.0, 170.0, 3.0)):
        angle = np.radians(degrees)
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        driven.set(time_s, place_of(compose((time_s, 0.0, 0.0), scale * turn)))
    for time_s, degrees, scale, x in ((0.0, 0.0, 1.0, 1.0), (1.5, 42.5, 1.5, 1.5), (9.0, 170.0, 3.0, 3.0)):
        angle = np.radians(degrees)
        pose = driven.pose(time_s)
        assert pose[:2, 0] == pytest.approx([scale * np.cos(angle), scale * np.sin(angle)], abs=1e-12)
        assert pose[0, 3] == pytest.approx(x)
    driven.set(3.0, ((7.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), 1.0))
    assert driven.pose(3.0)[0, 3] == 7.0, "a second pose for a time takes the place of the first"
    driven.forget_before(2.0)
    assert driven.pose(2.0)[0, 3] == 4.0
    driven.forget_before(5.0)
    assert driven.pose(2.0)[0, 3] == 7.0, "what no later pose needs is gone"
    driven.release()
    assert (driven.pose(3.0) == np.eye(4)).all()


def test_a_way_that_begins_later_begins_where_the_object_is(tmp_path: Path) -> None:
    start = look_at((0.0, 0.4, 3.0), (0.0, 0.4, 0.0))
    with simulator(tmp_path) as run:
        assert len(run.step(20_000)) == 0, "nothing moves"
        end = compose((0.2, 0.4, 3.0), np.eye(3))
        run.set_camera(end @ np.diag([1.0, -1.0, -1.0, 1.0]), axes="opencv")
        assert len(run.step(40_000)) > 50
        assert run.pose("camera", 20_000) == pytest.approx(start, abs=1e-12)
        assert run.pose("camera", 30_000)[0, 3] == pytest.approx(0.1)
        assert run.pose("camera") == pytest.approx(end)
        run.step(60_000)  # what was seen of the motion steers a few frames more
        assert len(run.step(100_000)) == 0, "it rests where it was put"


def test_light_is_data(tmp_path: Path) -> None:
    """What a lamp adds to the picture is as its radiance, sample by sample."""
    with simulator(tmp_path, sampling="adaptive") as run:

        def first_picture(*radiance: float) -> np.ndarray:
            run.reset()
            if radiance:
                run.set_light("lamp", radiance)
            run.step(0)
            return run.frame().planes[:3]

        # Where a lamp is dark there are no shadows, and no rays that look for them.
        scenes, dark, twice, four = (first_picture(*each) for each in ((), (0, 0, 0), (40, 40, 40), (80, 80, 80)))
        assert (scenes - dark).max() > 0.02
        np.testing.assert_allclose(four - twice, 2 * (twice - scenes), rtol=1e-4, atol=1e-6)
        red, other = first_picture(20.0, 0.0, 0.0), first_picture(40.0, 0.0, 0.0)
        np.testing.assert_allclose(red[0], scenes[0], rtol=1e-5, atol=1e-7)
        np.testing.assert_allclose(red[1:], other[1:], rtol=1e-5, atol=1e-7)
        run.set_light("lamp", (80.0, 80.0, 80.0))
        more = run.step(5_000)
        assert len(more) > 20 and more["on"].all(), "there is light from the next frame on"
        assert (first_picture() == scenes).all(), "after a reset the light is the scene's again"


def test_the_caller_says_when_frames_are(tmp_path: Path) -> None:
    with clsim.Simulator(scene(tmp_path, keyframed()), clock="caller", fps=100.0) as run:
        seen = []
        for until_us in (0, 777, 1_001, 1_001, 31_001):
            run.step(until_us)
            seen.append(run._next)
            assert run.time_us == until_us
        assert seen == [1, 2, 3, 3, 6], "30 ms are three parts of at most 10"
    with clsim.Simulator(scene(tmp_path, keyframed()), clock="wall") as run:
        run.step(0)
        begin = time.perf_counter()
        run.step(10_000)
        run.step(400_000)
        assert time.perf_counter() - begin > 0.39 and run.lag_s >= 0


def test_frames_can_be_seen(tmp_path: Path) -> None:
    with simulator(tmp_path) as run:
        with pytest.raises(Error, match="there is no frame yet"):
            run.frame()
        run.step(5_000)
        frame = run.frame()
        assert frame.time_us == 5_000 and frame.planes is not run._camera_pipeline._frame.planes
        assert frame.plane("G").mean() > 0.05


def test_another_seed_is_other_noise(tmp_path: Path) -> None:
    with simulator(tmp_path, seed=1) as run:
        run.step(0)
        first = run.frame().planes
        run.reset(seed=0)
        run.step(0)
        assert (run.frame().planes != first).any()
        run.reset(seed=1)
        run.step(0)
        assert (run.frame().planes == first).all()


def test_what_cannot_be_set_is_told(tmp_path: Path) -> None:
    with simulator(tmp_path) as run:
        with pytest.raises(InputError, match=r"called 'bx', expected one of: camera, floor, box, lamp"):
            run.set_pose("bx", np.eye(4))
        sheared, mirror, origin = np.eye(4) + 0.5 * np.eye(4, k=1), np.diag([1.0, -1.0, 1.0, 1.0]), (0.0, 0.0, 0.0)
        far = ((0.0, 0.0, np.inf), (0.0, 0.0, 0.0, 1.0))
        for pose in (np.eye(3), np.full((4, 4), np.nan), "here", sheared, mirror, origin, (origin, origin), far):
            with pytest.raises(InputError, match="`pose` must be a 4×4 matrix of a rotation"):
                run.set_pose("box", pose)
        with pytest.raises(InputError, match="no light called 'floor' shines in stage, expected one of: lamp"):
            run.set_light("floor", (1.0, 1.0, 1.0))
        with pytest.raises(InputError, match="`radiance` must not be negative"):
            run.set_light("lamp", (1.0, 1.0, -1.0))
        run.set_pose("box", np.eye(4), 1_001)
        with pytest.raises(InputError, match=r"box has a pose at 1001 µs already, .* got 1000"):
            run.set_pose("box", np.eye(4), 1_000)
        for end_us in (0, 5_000):
            run.step(end_us)
            with pytest.raises(InputError, match=f"`at_us` must be after the last frame, at {end_us} µs, got {end_us}"):
                run.set_pose("box", np.eye(4), end_us)
    with pytest.raises(InputError, match="`clock` must be one of frames, wall, caller, got 'fast'"):
        clsim.Simulator(scene(tmp_path), clock="fast")


def test_every_sort_of_light_has_its_own(tmp_path: Path) -> None:
    file = tmp_path / "lights.toml"
    light = '[[lights]]\nname = "NAME"\nkind = "KIND"\nintensity = [1.0, 2.0, 3.0]\n'
    file.write_text(
        "[camera]\nposition = [0.0, 0.0, 3.0]\n[materials.glow]\nemission = [1.0, 1.0, 1.0]\n"
        + '[[objects]]\nshape = "quad"\nmaterial = "glow"\n'
        + light.replace("NAME", "spot").replace("KIND", "spot")
        + light.replace("NAME", "sun").replace("KIND", "directional")
    )
    data = SceneData(clsim.load_scene(file))
    for name in ("glow", "sun"):
        data.set_light(name, (4.0, 5.0, 6.0))
    assert data.scene.materials.rows.numpy()["emission"].tolist() == [[0.0, 0.0, 0.0], [4.0, 5.0, 6.0]]
    assert data.scene.lights.punctual.intensity.numpy().tolist() == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]


def drive(run: clsim.Simulator) -> list[bytes]:
    """Move the box sideways, and return the events of each step of 5 ms."""
    events = []
    for number in range(1, 4):
        run.set_pose("box", ((0.02 * number, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)))
        events.append(run.step(5_000 * number).tobytes())
    return events


@pytest.mark.slow
def test_flow_to_the_next_frames_time_does_not_fix_what_is_there_then(tmp_path: Path) -> None:
    """For its sake the scene is moved to that time before the pose that will be there is set."""
    options: dict[str, Any] = {"clock": "caller", "fps": 200.0}
    with simulator(tmp_path, **options) as plain, simulator(tmp_path, truth=("flow",), **options) as run:
        events = drive(run)
        assert events == drive(plain) and len(b"".join(events)) > 100


@pytest.mark.slow
def test_truth_follows_what_is_set_and_changes_no_event(tmp_path: Path) -> None:
    """The box goes sideways across the view, so its front moves by focal length × way ÷ depth."""
    with simulator(tmp_path) as plain, simulator(tmp_path, truth=("depth", "ids", "backward-flow")) as run:
        events = drive(run)
        assert events == drive(plain) and len(b"".join(events)) > 100
        known = run.truth()
        assert set(known) == {"intensity", "depth", "object", "material", "backward-flow"}
        front = (known["object"] == 2) & (np.abs(known["depth"] - 2.6) < 1e-5)
        assert front.sum() > 20
        focal = 16 / np.tan(np.radians(25))
        expected = (-focal * 0.02 / 2.6, 0.0, 1.0, 1.0)
        assert np.abs(known["backward-flow"][front] - expected).max() < 1e-4
        still = (known["object"] == 1) & (known["backward-flow"][..., 3] > 0)
        assert still.sum() > 20 and np.abs(known["backward-flow"][still][:, :2]).max() < 1e-5
        with pytest.raises(InputError, match=r"this simulator has no flow: make it with truth"):
            run.truth("flow")


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"sensor": "davis346", "resolution": (32, 24)},
        {"sampling": "adaptive"},
        pytest.param({"method": "esim-ad"}, marks=pytest.mark.slow),
        pytest.param({"method": "esim", "noise": "independent"}, marks=pytest.mark.slow),
        pytest.param({"quality": "published"}, marks=pytest.mark.slow),
        pytest.param({"time": "adaptive", "fps": 200.0}, marks=pytest.mark.slow),
    ],
    ids=["balanced", "davis346", "adaptive sampling", "esim-ad", "independent", "published", "adaptive"],
)
def test_from_a_snapshot_the_same_happens_again(tmp_path: Path, options: dict[str, Any]) -> None:
    def goes_on() -> list[bytes]:
        run.set_pose("box", POSES[30_000], 30_000)
        parts = [run.step(25_000).tobytes()]
        if "time" not in options:
            run.set_light("lamp", (35.0, 30.0, 25.0))
        parts += [run.step(until_us).tobytes() for until_us in (35_000, 60_000)]
        return [*parts, run.frame().planes.tobytes()]

    with simulator(tmp_path, seed=3, **options) as run:
        run.set_pose("box", POSES[12_000], 12_000)
        run.step(20_000)
        saved, seen = run.snapshot(), run.frame().planes
        first = goes_on()
        assert len(b"".join(first[:3])) > 1000
        for _ in range(2):
            run.restore(saved)
            assert run.time_us == 20_000 and (run.frame().planes == seen).all() and goes_on() == first
        run.reset()
        with pytest.raises(InputError, match="`state` is of another simulator, or of before a reset"):
            run.restore(saved)


@pytest.mark.slow
def test_cached_light_is_in_a_snapshot() -> None:
    with clsim.Simulator("two-boxes", resolution=(32, 24), sampling="cached", fps=200.0) as run:
        run.step(20_000)
        saved = run.snapshot()
        first = run.step(60_000).tobytes()
        run.restore(saved)
        assert run.step(60_000).tobytes() == first and len(first) > 1000


def test_a_snapshot_needs_a_step(tmp_path: Path) -> None:
    with simulator(tmp_path) as run, pytest.raises(Error, match="there is nothing to remember yet"):
        run.snapshot()


def test_what_is_driven_is_never_baked() -> None:
    made = clsim.WorldBuilder(Camera(8, 6, 50.0, Static(np.eye(4))))
    for name in ("wall", "arm"):
        made.add_parts(name, {part: (box((1.0, 1.0, 1.0)), np.eye(4), Material()) for part in ("a", "b")})
    driving = Driving(made.world())
    driving.set_place("arm", ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), 1.0), None, None)
    placement = place(driving.seal())
    assert [instance.name for instance in placement.instances] == ["", "arm/a", "arm/b"], "the walls are one mesh"
    with pytest.raises(InputError, match="wall stands still in world and is built in"):
        driving.set_place("wall", ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), 1.0), 5, 0)


def test_names_that_several_objects_have_name_none(tmp_path: Path) -> None:
    file = tmp_path / "twins.toml"
    twin = '[[objects]]\nname = "twin"\nshape = "box"\n'
    file.write_text("[camera]\nposition = [0.0, 0.0, 3.0]\n[environment]\nradiance = [1.0, 1.0, 1.0]\n" + twin + twin)
    assert tuple(placed(clsim.load_scene(file))) == ("camera",)


def test_the_cache_is_emptied_once_a_lamp_is_set() -> None:
    """Half the light at once: the mean of what paths found before and after would be brighter."""
    with clsim.Simulator("two-boxes", resolution=(32, 24), fps=200.0) as run:
        run.step(10_000)
        before = run.frame().planes[:3].mean()
        run.set_light("lamp", (0.0, 0.0, 0.0))
        events = run.step(15_000)
        assert run.frame().planes[:3].mean() < 0.7 * before
        assert len(events) > 300 and not events["on"].mean() > 0.1


def test_a_reset_forgets_poses_that_were_set_for_later(tmp_path: Path) -> None:
    """Those for the end of the next step, and those for a time."""
    with simulator(tmp_path) as run:
        run.step(5_000)
        first = run.frame().planes
        run.reset()
        for at_us in (None, 3_000, 90_000):
            run.set_pose("box", compose((0.5, 0.0, 0.0), np.eye(3)), at_us)
            run.reset()
            run.step(5_000)
            assert (run.pose("box") == np.eye(4)).all()
            assert (run.frame().planes == first).all()
            run.reset()


@given(st.floats(0.5, 2000.0), st.lists(st.integers(0, 200_000), min_size=1, max_size=6))
@example(1.0, [1])
@example(1e3 / 0.7, [700])  # which is a rounding error more than a frame
def test_a_callers_steps_are_parts_of_one_length_no_longer_than_a_frame(fps: float, steps: list[int]) -> None:
    clock, number, passed_us = StepClock("caller", fps), 0, 0
    for length_us in steps:
        times = clock.frame_times(number, passed_us, passed_us + length_us)
        assert (times[0] == 0) == (number == 0) if times else length_us == 0
        parts = times[1:] if number == 0 else times
        count = max(1, len(parts))
        # Rounded to whole microseconds, and as few as there can be.
        assert all(abs(t - passed_us - length_us * (k + 1) / count) <= 0.5 for k, t in enumerate(parts))
        frames = length_us * fps / 1e6
        assert (count == 1 or count - 1 < frames - 5e-7) and frames <= count + 1e-3
        if length_us:
            assert parts[-1] == passed_us + length_us
        number, passed_us = number + len(times), passed_us + length_us


def test_a_way_that_begins_later_begins_where_the_scenes_own_motion_has_led(tmp_path: Path) -> None:
    """The box goes by its keyframes until it is set; from there the way is straight, and the rest of the keys void."""
    with clsim.Simulator(scene(tmp_path, keyframed()), time="fixed") as run:
        own = [run.pose("box", time_us) for time_us in (12_000, 20_000)]
        np.testing.assert_allclose(own[0][:3, 3], KEYS[1][1], atol=1e-12)
        run.step(20_000)
        end = compose((-0.4, 0.1, 0.2), np.eye(3))
        run.set_pose("box", end, 40_000)
        for time_us, share in ((20_000, 0.0), (25_000, 0.25), (40_000, 1.0), (70_000, 1.0)):
            expected = (1 - share) * own[1][:3, 3] + share * end[:3, 3]
            np.testing.assert_allclose(run.pose("box", time_us)[:3, 3], expected, atol=1e-9)
        np.testing.assert_allclose(run.pose("box", 20_000), own[1], atol=1e-9)


@pytest.mark.slow
def test_flow_leads_on_by_the_time_of_a_frame(tmp_path: Path) -> None:
    """The box goes sideways at 1 m/s: its front, 2.6 m away, by focal length · 1/fps ÷ depth."""
    keys = "keyframes = [{ time_s = 0, position = [0, 0, 0] }, { time_s = 1, position = [1, 0, 0] }]"
    for fps in (200.0, 50.0):
        with clsim.Simulator(scene(tmp_path, keys), truth=("depth", "flow"), fps=fps, clock="caller") as run:
            run.step(0)
            known = run.truth()
        front = np.abs(known["depth"] - 2.6) < 1e-5
        expected = 16 / np.tan(np.radians(25)) / fps / 2.6
        assert front.sum() > 20
        np.testing.assert_allclose(known["flow"][front][:, :2], np.tile((expected, 0.0), (front.sum(), 1)), atol=1e-4)
