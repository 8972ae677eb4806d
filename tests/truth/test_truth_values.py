"""Truth value by value: what files and frames say, by formulas and readers that are not ours."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from clsim.errors import InputError
from clsim.events import EVENT_DTYPE
from clsim.frames import Frame, page_aligned, rendered_planes
from clsim.scene import Camera, Instance, Static, World
from clsim.scene.motion import Orbit, compose
from clsim.scene.world import SphereLight
from clsim.truth.cut import cut
from clsim.truth.formats.dsec import disparity_image, flow_image
from clsim.truth.formats.hdf5 import Hdf5Layout
from clsim.truth.layouts import LAYOUTS, LayoutKind, held_by, open_layout
from clsim.truth.motions import Motions
from clsim.truth.names import TRUTH_NAMES
from clsim.truth.record import Layout, Shot, TrackChunk
from clsim.truth.recorder import Plan, TruthRecorder
from clsim.truth.recording import read_recording
from clsim.truth.world_facts import object_names, poses_at_start
from clsim.truth.writing.png import read_png, write_png
from tests.truth import recordings


def frame(time_us: int = 0, index: int = 0) -> Frame:
    names = rendered_planes().names
    planes = page_aligned((len(names), 2, 3))
    planes[...] = np.random.default_rng(index).uniform(0, 1, planes.shape)
    return Frame(planes, names, time_us, index)


def test_intensity_is_the_luminance_of_rec_709() -> None:
    """ITU-R BT.709: 0.2126 R + 0.7152 G + 0.0722 B; white of 1 has a luminance of 1."""
    seen = frame()
    red, green, blue = (seen.plane(name).astype(np.float64) for name in "RGB")
    np.testing.assert_allclose(
        cut(seen, ("intensity",))["intensity"], 0.2126 * red + 0.7152 * green + 0.0722 * blue, 1e-5
    )


def test_truth_needs_an_output_only_where_both_are_asked_for() -> None:
    """Without outputs, programs take the truth themselves; without truth, any output will do."""
    assert held_by((), ("depth",)) == ("depth",) and held_by(("events.raw",), ()) == ()
    with pytest.raises(InputError, match="`truth` needs an output that can hold it"):
        held_by(("events.raw",), ("depth",))


@pytest.mark.parametrize("kinds", [*((kind,) for kind in LAYOUTS), (LAYOUTS[1], LAYOUTS[3]), LAYOUTS], ids=len)
def test_of_all_truth_what_some_output_holds_is_recorded_and_no_more(kinds: tuple[LayoutKind, ...]) -> None:
    outputs = ["events.raw", *(f"run{kind.endings[0]}" for kind in kinds)]
    assert set(held_by(outputs, ("all",))) == {name for kind in kinds for name in kind.holds}
    for name in TRUTH_NAMES:
        if any(name in kind.holds for kind in kinds):
            assert held_by(outputs, (name,)) == (name,)
        else:
            with pytest.raises(InputError, match=f"`truth` {name} fits none of the outputs"):
                held_by(outputs, (name,))


class Notes(Layout):
    """Takes what a recorder hands over."""

    def __init__(self) -> None:
        self.shots: list[Shot] = []
        self.poses_us: list[int] = []

    def events(self, batch: np.ndarray, end_us: int) -> None: ...

    def shot(self, shot: Shot) -> None:
        self.shots.append(shot)

    def track(self, chunk: TrackChunk) -> None:
        self.poses_us += chunk.times_us.tolist()

    def close(self) -> None: ...


@settings(max_examples=30)
@given(st.lists(st.integers(0, 9), max_size=20), st.integers(1, 3))
def test_a_frames_index_is_that_of_the_first_event_at_or_after_it(times: list[int], every: int) -> None:
    """Frames at 0, 3, 6 and 9 µs; events at these very times come after them."""
    about, notes = recordings.about(names=("intensity",)), Notes()
    motions = Motions(about, Static(np.eye(4)), (), 200.0, 0)
    recorder = TruthRecorder(Plan(about, every, lambda index: 3 * index, motions), notes)
    t = np.sort(np.array(times, np.int64))
    for index in range(4):
        batch = np.zeros(np.count_nonzero((t <= 3 * index) & (t > 3 * index - 3)), EVENT_DTYPE)
        batch["t"] = t[(t <= 3 * index) & (t > 3 * index - 3)]
        recorder.record(frame(3 * index, index), batch)
    assert [shot.time_us for shot in notes.shots] == list(range(0, 10, 3 * every))
    for shot in notes.shots:
        assert shot.event_index == np.count_nonzero(t < shot.time_us)
        assert (shot.before_us, shot.after_us) == (shot.time_us - 3 * every, shot.time_us + 3 * every)


@pytest.mark.parametrize("every", [1, 3, 4])
def test_each_pose_is_told_once_up_to_the_last_frame(every: int) -> None:
    """Whether truth is recorded of that or not; to close twice adds nothing."""
    about, notes = recordings.about(names=("poses",)), Notes()
    motions = Motions(about, recordings.ORBIT, (), 200.0, 0)
    recorder = TruthRecorder(Plan(about, every, lambda index: 10_000 * index, motions), notes)
    for index in range(4):
        recorder.record(frame(10_000 * index, index), np.zeros(0, EVENT_DTYPE))
    recorder.close()
    recorder.close()
    assert notes.poses_us == list(range(0, 30_001, 5_000))


def test_flow_of_dsec_tells_from_when_to_when(tmp_path: Path) -> None:
    given = recordings.feed(open_layout(str(tmp_path / "run.dsec"), recordings.about()))
    for way, sign in (("forward", 1), ("backward", -1)):
        told = np.loadtxt(tmp_path / "run.dsec" / "flow" / f"{way}_timestamps.txt", np.int64, delimiter=",")
        # What would lead to before or beyond the recording is not there: nothing tells of events then.
        assert told[:, 0].tolist() == [shot.time_us for shot in (given.shots[:-1] if sign > 0 else given.shots[1:])]
        assert (told[:, 1] - told[:, 0] == sign * recordings.STEP_US).all()
        assert len(list((tmp_path / "run.dsec" / "flow" / way).iterdir())) == len(told)


def test_hdf5_tells_validity_and_covisibility_apart_when_it_is_read(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    given = recordings.feed(Hdf5Layout(path, recordings.about()))
    for shot, read in zip(given.shots, read_recording(str(path)).shots(), strict=True):
        for name in ("flow", "backward-flow"):
            found, expected = read.planes[name], shot.planes[name]
            np.testing.assert_array_equal(found[..., :2], expected[..., :2])
            np.testing.assert_array_equal(found[..., 2:] > 0, expected[..., 2:] > 0)
        assert (found[..., 2] != found[..., 3]).any(), "or both could be swapped"


@pytest.mark.parametrize("rate", [200.0, 300.0, 24.0, 49.0, 999.0])
def test_poses_are_at_multiples_of_their_period_to_the_nearest_microsecond(rate: float) -> None:
    about = recordings.about()
    motions = Motions(about, recordings.ORBIT, (("ball", recordings.BALL),), rate, 0)
    found = [motions.until(end_us)[0] for end_us in (0, 1_000, 33_333, 100_000, 1_000_000)]
    for of in (0, 1):
        times = np.concatenate([tracks[of].times_us for tracks in found if tracks])
        exact = np.arange(int(rate) + 1) * 1e6 / rate  # the last at the end itself
        assert len(times) == len(exact) and np.abs(times - exact).max() <= 0.5


def test_objects_start_where_and_how_they_stand() -> None:
    """Scipy reads the quaternions back; a scale is no part of a pose, and lamps are objects too."""
    turn = Rotation.from_euler("xyz", (20, -50, 130), degrees=True)
    placed = compose((1.0, 2.0, 3.0), 2.5 * turn.as_matrix())
    lamp = Orbit((0.0, 1.0, 0.0), 2.0, 4.0, start_deg=90.0)
    world = World(
        "w", Camera(4, 4, 60.0, Static(np.eye(4))), (), (Instance(0, Static(placed), "box"),), (),
        sphere_lights=(SphereLight(0.1, (1.0, 1.0, 1.0), lamp),),
    )  # fmt: skip
    box, light = poses_at_start(world)
    assert len(object_names(world)) == 2
    np.testing.assert_allclose(box[:3], (1, 2, 3))
    np.testing.assert_allclose(Rotation.from_quat(box[3:]).as_matrix(), turn.as_matrix(), atol=1e-9)
    np.testing.assert_allclose(light[:3], (2, 1, 0), atol=1e-12)


def test_objects_of_one_name_are_told_apart() -> None:
    world = World(
        "w", Camera(4, 4, 60.0, Static(np.eye(4))), (),
        tuple(Instance(0, Static(np.eye(4)), name) for name in ("box", "ball", "box", "")), (),
    )  # fmt: skip
    assert object_names(world) == ("box#1", "ball", "box#2", "objects[3]")


def test_all_pictures_of_a_recording_have_one_exposure() -> None:
    """What gets darker looks darker, for good: the exposure does not follow."""
    about, notes = recordings.about(names=("image",)), Notes()
    recorder = TruthRecorder(
        Plan(about, 1, lambda index: 3 * index, Motions(about, Static(np.eye(4)), (), 200.0, 0)), notes
    )
    for index, gain in enumerate((1.0, 0.5, 0.5)):
        seen = frame(3 * index, index)
        seen.planes[...] = gain
        recorder.record(seen, np.zeros(0, EVENT_DTYPE))
    # The first's 95th percentile is shown as 0.8 (docs/ground-truth.md); IEC 61966-2-1 of 0.8 and 0.4.
    assert [int(shot.planes["image"].max()) for shot in notes.shots] == [231, 170, 170]


def test_what_is_too_near_or_too_far_for_disparity_has_none():
    """DSEC's 16 bits hold less than 256 pixels, and 0 is no disparity."""
    depth = np.array([[0.0, 0.39, 0.3907, 1.0, 20_000.0, 60_000.0, np.inf]], np.float32)
    found = disparity_image(depth, 100.0)
    assert found.tolist() == [[0, 0, 65_523, 25_600, 1, 0, 0]]


def test_an_object_beyond_16_bits_is_not_taken_for_another(tmp_path: Path) -> None:
    layout = open_layout(str(tmp_path / "run.dsec"), recordings.about())
    ids = np.full((recordings.HEIGHT, recordings.WIDTH), 65_536 + 2, np.float32)
    ids[0] = 2
    layout.shot(Shot(0, 0, 0, 0, {"depth": np.ones_like(ids), "object": ids}))
    layout.close()
    found = read_png(tmp_path / "run.dsec" / "ids" / "object" / "000000.png")
    assert (found[0] == 2).all() and (found[1:] == 65_535).all()


def test_flow_that_goes_too_far_for_16_bits_is_not_known() -> None:
    """DSEC tells of up to 256 pixels either way; more must not come back as something else."""
    ways = np.array([[-300, 0], [300, 0], [0, -300], [0, 300], [-255, 255], [255, -255]], np.float32)
    coded = flow_image(np.concatenate([ways, np.ones((6, 2), np.float32)], axis=1)[None])[0].astype(float)
    assert coded[:, 2].tolist() == [0, 0, 0, 0, 1, 1]
    np.testing.assert_array_equal((coded[4:, :2] - 32768) / 128, ways[4:])


@given(st.lists(st.floats(-300, 300, width=32), min_size=2, max_size=2), st.sampled_from([1.0, 256.0, 255.9]))
@example([255.998, -255.998], 1.0)
def test_flow_that_dsec_can_tell_comes_back_and_no_other(way: list[float], unit: float) -> None:
    """Just below 256 pixels, rounding would lead beyond 16 bits, and so to the other side."""
    flow = np.array([[[way[0], way[1], 1.0, 1.0], [unit, -unit, 1.0, 1.0]]], np.float32)
    coded = flow_image(flow)[0].astype(float)
    for (x, y, _, _), (red, green, valid) in zip(flow[0], coded, strict=True):
        if valid:
            np.testing.assert_allclose(((red - 32768) / 128, (green - 32768) / 128), (x, y), atol=0.5 / 128)
        else:
            assert max(abs(x), abs(y)) > 255.8


@pytest.mark.parametrize("with_depth", [True, False])
def test_mvsec_has_no_flow_of_the_sky(tmp_path: Path, with_depth: bool) -> None:
    """It has flow by its depth, and so do they who score by it; where no depth is recorded, nobody knows the sky."""
    size = recordings.HEIGHT, recordings.WIDTH
    depth, flow = np.full(size, 2.0, np.float32), np.ones((*size, 4), np.float32)
    depth[:5], flow[-2:, :, 2] = np.inf, 0
    planes = {"flow": flow} | ({"depth": depth} if with_depth else {})
    path = str(tmp_path / "run.mvsec")
    layout = open_layout(path, recordings.about(names=tuple(planes)))
    layout.shot(Shot(0, 0, 10_000, 0, planes))
    layout.close()
    (found,) = read_recording(path).shots()
    known = (np.isfinite(depth) | (not with_depth)) & (flow[..., 2] > 0)
    assert np.array_equal(found.planes["flow"][..., 2] > 0, known)


def test_a_picture_of_ecd_comes_before_the_event_at_its_own_time(tmp_path: Path) -> None:
    """It is counted which events are before it, as where clsim has recorded it."""
    home = tmp_path / "a.ecd"
    (home / "images").mkdir(parents=True)
    (home / "events.txt").write_text("".join(f"{t / 10:.6f} 1 2 1\n" for t in (1, 2, 2, 3)))
    (home / "calib.txt").write_text("100 100 4 3 0 0 0 0 0\n")
    write_png(home / "images" / "a.png", np.zeros((6, 8), np.uint8))
    times_s = (0.05, 0.1, 0.15, 0.2, 0.3, 0.4)
    (home / "images.txt").write_text("".join(f"{t:.6f} images/a.png\n" for t in times_s))
    assert [shot.event_index for shot in read_recording(str(home)).shots()] == [0, 0, 1, 1, 3, 4]


def test_what_dsec_calls_covisible_is_seen_at_both_times(tmp_path: Path) -> None:
    given = recordings.feed(open_layout(str(tmp_path / "run.dsec"), recordings.about()))
    for number, shot in enumerate(given.shots[:-1]):
        seen = read_png(tmp_path / "run.dsec" / "flow" / "forward_covisible" / f"{number:06d}.png")
        assert np.array_equal(seen, shot.planes["flow"][..., 3] > 0)


def test_poses_and_calibration_of_tum_vie_are_not_written_by_the_right_camera(tmp_path: Path) -> None:
    """They would take the place of the left one's, whose they are."""
    recordings.feed(open_layout(str(tmp_path / "run.tumvie"), recordings.about(side="right")))
    written = sorted(each.name for each in (tmp_path / "run.tumvie").iterdir())
    assert written == ["right_images", "run-events_right.h5"]
