"""Live runs that record truth."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

import clsim
from clsim.errors import InputError

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


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"truth": "colour"}, r"`truth` 'colour' is unknown; expected all, or of intensity"),
        ({"truth": "depth", "outputs": "a.npz"}, r"`truth` needs an output that can hold it.*\.h5"),
        ({"truth": "depth", "outputs": "a.h5", "frame_rate": 50.0}, r"`frame_rate` must go into the 120 frames"),
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
