"""Live runs that record truth."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

import clsim
from clsim.errors import InputError
from clsim.events import CAUSES
from clsim.events.outputs import FileOptions
from clsim.live.pacing.schedule import Schedule
from clsim.live.recording import _plan
from clsim.live.settings import OutputSettings
from clsim.scene import load_world
from clsim.sensor import SensorSettings
from clsim.sensor.pixel_stages import Leak
from clsim.truth.names import TRUTH_NAMES
from clsim.truth.recording import read_recording

SIZE = (32, 24)


@pytest.mark.slow
def test_truth_stands_beside_the_same_events(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    common = {"resolution": SIZE, "frame_count": 9, "quality": "draft", "fps": 120.0}
    with clsim.stream("two-boxes", **common) as run:
        plain = np.concatenate(list(run))
    with clsim.stream("two-boxes", **common, truth="all", frame_rate=30.0, outputs=str(path)) as run:
        events = np.concatenate(list(run))
        assert run.summary.outputs[-1]["recorded_frames"] == 3
    assert events.tobytes() == plain.tobytes() == clsim.open(str(path)).read().tobytes()
    with h5py.File(path) as file:
        times = file["frames/t"][:]
        assert times.tolist() == [0, 33_333, 66_667]
        assert file["frames/flow_end"][:].tolist() == [
            33_333,
            66_667,
            100_000,
        ]
        assert file["frames/event_index"][:].tolist() == np.searchsorted(plain["t"], times).tolist()
        assert file["poses/camera/t"][:].tolist() == list(range(0, 66_668, 5_000))
        assert len(file["imu/t"]) == 67
        ids = file["frames/object"][:]
        assert [name.decode() for name in file["objects/name"]] == ["floor", "red box", "pale box", "lamp"]
        assert set(np.unique(ids)) >= {1, 2, 3}
        depth = file["frames/depth"][:]
        with clsim.Simulator("two-boxes", resolution=SIZE, fps=30.0, quality="draft", truth=("depth", "ids")) as other:
            for shown, known, time_us in zip(depth, ids, times, strict=True):
                other.step(int(time_us))
                assert np.array_equal(other.truth("depth")["depth"], shown)
                assert np.array_equal(other.truth("ids")["object"], known)
        assert np.abs(file["frames/intensity"][0]).max() > 0.1
        assert not file["frames/backward_flow_valid"][0].any() and file["frames/backward_flow_valid"][1].all()


def test_things_have_a_track_if_they_move(tmp_path: Path) -> None:
    """One that stands still has its pose at the start alone, and is not among those that move when read again."""
    scene, path = tmp_path / "scene.toml", tmp_path / "run.h5"
    ways = {"near": "", "far": "orbit = { center = [0.0, 0.0, 0.0], radius_m = 1.0, period_s = 2.0 }\n", "low": ""}
    boxes = (f'[[objects]]\nname = "{name}"\nshape = "box"\n{way}' for name, way in ways.items())
    scene.write_text("[camera]\nposition = [0.0, 0.0, 5.0]\n[environment]\nradiance = [1, 1, 1]\n" + "".join(boxes))
    few = {"resolution": (8, 6), "frame_count": 3, "method": "esim", "spp": 1}
    with clsim.stream(str(scene), **few, truth="poses", outputs=str(path)) as stream:
        list(stream)
    with h5py.File(path) as file:
        tracks = {group.attrs["name"]: len(group["t"]) for group in file["poses"].values()}
        assert set(tracks) == {"camera", "far"} and len(set(tracks.values())) == 1 and tracks["far"] >= 3
        assert len(file["objects/pose"]) == len(ways)
    assert read_recording(str(path)).about.moving == ("far",)


def test_another_seed_is_other_noise_of_the_inertial_sensor(tmp_path: Path) -> None:
    kalibr, found = tmp_path / "imu.yaml", {}
    names = ("accelerometer_noise_density", "accelerometer_random_walk", "gyroscope_noise_density")
    kalibr.write_text("".join(f"{name}: 0.01\n" for name in (*names, "gyroscope_random_walk")))
    for run, seed in (("a", 1), ("b", 2), ("again", 1)):
        path = str(tmp_path / f"{run}.h5")
        options = {"method": "esim", "spp": 1, "seed": seed, "truth": "imu", "imu_noise": str(kalibr), "outputs": path}
        with clsim.stream("still", resolution=(8, 6), frame_count=3, **options) as stream:
            list(stream)
        with h5py.File(path) as file:
            found[run] = np.hstack([file[f"imu/{name}"][:] for name in ("acceleration", "angular_velocity")])
    assert len(found["a"]) > 10 and (found["a"] != found["b"]).all() and (found["a"] == found["again"]).all()


@pytest.mark.slow
def test_labels_tell_cause_and_object_in_every_file_that_holds_them(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    names = [str(tmp_path / name) for name in ("truth.h5", "plain.parquet")]
    sensor = SensorSettings(leak=Leak(20.0, 0.2))
    common = {"resolution": SIZE, "frame_count": 9, "quality": "draft", "fps": 120.0, "sensor": sensor}
    files = FileOptions(labels=True)
    with clsim.stream("two-boxes", **common, truth=("labels", "ids"), outputs=names, files=files) as run:
        events = np.concatenate(list(run))
    with h5py.File(names[0]) as file:
        causes, objects = file["events/cause"][:], file["events/object"][:]
        assert list(file["events/cause"].attrs["causes"]) == list(CAUSES)
        ids = file["frames/object"][:]
    table = parquet.read_table(names[1])
    np.testing.assert_array_equal(table["cause"].to_numpy(), causes)
    np.testing.assert_array_equal(table["object"].to_numpy(), objects)
    assert len(causes) == len(events) and set(causes) == {CAUSES.index("signal"), CAUSES.index("leak")}
    # Frames at k / 120 s: each event has the number that its pixel shows in the nearer one.
    shown = ids[np.round(events["t"] * 120e-6).astype(int), events["y"], events["x"]]
    assert (shown == objects).mean() > 0.999 and len(np.unique(objects)) >= 3


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"truth": "depth", "outputs": "a.h5", "files": FileOptions(labels=True)}, "add labels to `truth`"),
        ({"truth": "colour"}, r"`truth` 'colour' is unknown; expected all, none, or of intensity"),
        ({"truth": "depth", "outputs": "a.npz"}, r"`truth` needs an output that can hold it.*\.h5"),
        ({"truth": "distance", "outputs": "a.dsec"}, r"`truth` distance fits none.*\.h5"),
        ({"truth": "depth", "outputs": "a.h5", "frame_rate": 50.0}, r"`fps` \(120\) must be a multiple of `frame_"),
        ({"truth": "depth", "outputs": "a.h5", "loop": True}, "without `loop`"),
        ({"frame_rate": 30.0}, "`frame_rate` is that of `truth`"),
        ({"truth": "imu", "outputs": "a.h5", "imu_rate": 0.0}, "`imu_rate` must be positive"),
        ({"truth": "imu", "outputs": "no-folder/a.h5"}, "there is no folder"),
        ({"truth": "imu", "outputs": "a.h5", "imu_noise": "none.yaml"}, "none.yaml: cannot be read"),
    ],
)
def test_what_cannot_be_is_told_before_anything_is_written(tmp_path: Path, monkeypatch, options, message) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=message):
        clsim.stream("two-boxes", fps=120.0, **options)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("outputs", "held"),
    [
        (("a.tum",), {"poses"}),
        (("a.event_utils", "b.tum", "c.raw"), {"intensity", "image", "flow", "poses"}),
        (("a.h5",), set(TRUTH_NAMES)),
        ((), set(TRUTH_NAMES)),
    ],
)
def test_all_truth_is_what_the_outputs_hold(outputs: tuple[str, ...], held: set[str]) -> None:
    assert set(OutputSettings(outputs=outputs, truth=("all",)).truth) == held


@pytest.mark.parametrize("every", [1, 4])
def test_files_are_told_how_often_truth_comes(every: int) -> None:
    """As often as it is recorded, which may be seldomer than frames are rendered."""
    options = OutputSettings(outputs=("a.h5",), truth=("depth",))
    told = _plan(options, 0, load_world("still"), Schedule(100.0, 10, 11), {}, every).about
    assert (told.frame_rate, told.names) == (100.0 / every, ("depth",))
