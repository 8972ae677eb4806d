"""clsim's own layout, read with h5py alone and by DSEC's rules."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

import clsim
from clsim.events.formats.tables import hdf5_growing
from clsim.truth.formats.hdf5 import Hdf5Layout
from clsim.truth.kinematics import track
from clsim.truth.record import ImuChunk
from clsim.truth.recording import convert_recording, read_recording
from tests.truth import recordings


def test_everything_is_there_to_the_bit(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    given = recordings.feed(Hdf5Layout(path, recordings.about()))
    with h5py.File(path) as file:
        frames = file["frames"]
        assert frames["t"][:].tolist() == [shot.time_us for shot in given.shots]
        assert frames["event_index"][:].tolist() == [shot.event_index for shot in given.shots]
        for name in ("intensity", "image", "depth", "distance", "normal", "albedo", "object", "material"):
            stored = np.stack([shot.planes[name] for shot in given.shots])
            assert np.array_equal(frames[name][:], stored), name
            assert frames[name].attrs["unit"] and frames[name].attrs["meaning"]
            assert frames[name].compression == "gzip" and frames[name].chunks[0] == 1
        for name, end in (("flow", "flow_end"), ("backward_flow", "flow_start")):
            flows = np.stack([shot.planes[name.replace("_", "-")] for shot in given.shots])
            assert np.array_equal(frames[name][:], flows[..., :2])
            assert np.array_equal(frames[f"{name}_valid"][:], flows[..., 2])
            assert np.array_equal(frames[f"{name}_covisible"][:], flows[..., 3])
            step = recordings.STEP_US if end == "flow_end" else -recordings.STEP_US
            assert np.array_equal(frames[end][:], frames["t"][:] + step)
        for group in ("poses/camera", "poses/0001"):
            track = given.tracks[file[group].attrs["name"]]
            assert np.array_equal(file[group]["t"][:], track.times_us)
            assert np.array_equal(file[group]["pose"][:], track.poses)
            assert np.array_equal(file[group]["velocity"][:], track.velocities)
        assert np.array_equal(file["imu/t"][:], given.imu.times_us)
        assert np.array_equal(file["imu/acceleration"][:], given.imu.acceleration)
        assert np.array_equal(file["imu/angular_velocity"][:], given.imu.angular_velocity)
        assert np.array_equal(file["events/object"][:], given.labels["object"])
        assert np.array_equal(file["events/cause"][:], given.labels["cause"])
        assert np.array_equal(file["events/flow"][:], given.labels["flow"])
        assert [name.decode() for name in file["objects/name"]] == ["floor", "ball"]
        assert "OpenCV" in file.attrs["conventions"]
    assert np.array_equal(clsim.open(str(path)).read(), given.events)
    again = str(tmp_path / "again.h5")
    convert_recording(str(path), again)
    with h5py.File(path) as one, h5py.File(again) as other:

        def look(name: str, found: h5py.Group | h5py.Dataset) -> None:
            assert set(found.attrs) == set(other[name].attrs)
            if isinstance(found, h5py.Dataset):
                assert np.array_equal(found[()], other[name][()]), name

        one.visititems(look)
        assert dict(one.attrs) == dict(other.attrs)


def test_events_are_dsecs(tmp_path: Path) -> None:
    """The slicer's invariant: t[ms_to_idx[ms]] >= 1000·ms > t[ms_to_idx[ms] − 1]."""
    path = tmp_path / "run.h5"
    given = recordings.feed(Hdf5Layout(path, recordings.about()))
    with h5py.File(path) as file:
        t, index = file["events/t"][:].astype(np.int64), file["ms_to_idx"][:].astype(np.int64)
        assert int(file["t_offset"][()]) == 0 and np.array_equal(t, given.events["t"])
        marks = 1000 * np.arange(len(index))
        inner = index < len(t)
        assert (t[index[inner]] >= marks[inner]).all() and (t[index[1:] - 1] < marks[1:]).all()
        for when, at in zip(file["frames/t"][:], file["frames/event_index"][:], strict=True):
            assert (t[:at] < when).all() and (t[at:] >= when).all()


def test_only_what_is_asked_for_is_there(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    layout = Hdf5Layout(path, recordings.about(names=("depth",)))
    layout.close()
    with h5py.File(path) as file:
        assert set(file["frames"]) == {"t", "event_index", "depth"} and not {"poses", "imu", "objects"} & set(file)


def test_a_kill_leaves_what_was_flushed(tmp_path: Path) -> None:
    """A process ends without closing anything; all frames that were handed over are there, and can be read."""
    path = tmp_path / "run.h5"
    folder = Path(__file__).parent
    code = (
        "import os, sys, pathlib, recordings; from clsim.truth.formats.hdf5 import Hdf5Layout\n"
        f"recordings.feed(Hdf5Layout(pathlib.Path({str(path)!r}), recordings.about()), close=False)\n"
        "os._exit(9)"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | {"PYTHONPATH": f"{folder}:{folder.parent.parent}"}, check=False
    )
    assert ended.returncode == 9
    expected = recordings.feed(Hdf5Layout(tmp_path / "whole.h5", recordings.about()))
    with h5py.File(path) as file:
        assert np.array_equal(file["frames/depth"][:], np.stack([s.planes["depth"] for s in expected.shots]))
        assert np.array_equal(file["imu/t"][:], expected.imu.times_us)
        assert np.array_equal(file["events/t"][:], expected.events["t"])


def test_labels_are_read_as_far_as_all_of_them_came(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    given = recordings.feed(Hdf5Layout(path, recordings.about()))
    with h5py.File(path, "r+") as file:
        file["events/cause"].resize((300,))
    (labels,) = read_recording(str(path)).labels()
    assert np.array_equal(labels, given.labels[:300])


@pytest.mark.slow
def test_every_prefix_of_the_writes_can_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever write is the last before a kill, each frame whose time is there is whole."""
    path, copy = tmp_path / "run.h5", tmp_path / "copy.h5"
    put = hdf5_growing._Medium._put
    expected = recordings.feed(Hdf5Layout(tmp_path / "whole.h5", recordings.about()))
    depth = np.stack([shot.planes["depth"] for shot in expected.shots])
    flow = np.stack([shot.planes["flow"][..., :2] for shot in expected.shots])
    found = []

    def put_and_look(medium: hdf5_growing._Medium, offset: int, data: bytes) -> None:
        put(medium, offset, data)
        if medium._waiting is None:
            return
        shutil.copy(path, copy)
        with h5py.File(copy) as file:
            names = ("t", "depth", "flow", "event_index")
            n = min(len(file["frames"][name]) for name in names)
            assert np.array_equal(file["frames/depth"][:n], depth[:n])
            assert np.array_equal(file["frames/flow"][:n], flow[:n])
            m = min(len(file["imu"][name]) for name in ("t", "acceleration"))
            assert np.array_equal(file["imu/acceleration"][:m], expected.imu.acceleration[:m])
            found.append(n)

    monkeypatch.setattr(hdf5_growing._Medium, "_put", put_and_look)
    recordings.feed(Hdf5Layout(path, recordings.about()))
    assert found == sorted(found) and set(found) == {0, 1, 2, 3, 4}


@pytest.mark.parametrize("name", ["t", "depth", "flow", "event_index"])
def test_frames_are_read_as_far_as_all_of_them_is_there(tmp_path: Path, name: str) -> None:
    path = tmp_path / "run.h5"
    expected = recordings.feed(Hdf5Layout(path, recordings.about())).shots
    with h5py.File(path, "r+") as file:
        file["frames"][name].resize(len(expected) - 1, axis=0)
    found = list(read_recording(str(path)).shots())
    assert [shot.time_us for shot in found] == [shot.time_us for shot in expected[:-1]]


def test_what_comes_after_the_last_frame_is_there_when_the_file_is_closed(tmp_path: Path) -> None:
    """A run ends between two frames of truth: poses, inertial samples and labels go on until then."""
    path = tmp_path / "run.h5"
    layout = Hdf5Layout(path, recordings.about())
    given = recordings.feed(layout, close=False)
    end_us = recordings.SHOTS * recordings.STEP_US
    times_us = np.arange(given.tracks["camera"].times_us[-1] + 5000, end_us, 5000)
    late = {
        name: track(name, motion, times_us)
        for name, motion in (("camera", recordings.ORBIT), ("ball", recordings.BALL))
    }
    for chunk in late.values():
        layout.track(chunk)
    samples = ImuChunk(times_us, np.random.default_rng(1).normal(size=(len(times_us), 3)), np.ones((len(times_us), 3)))
    layout.imu(samples)
    layout.close()
    assert len(times_us) > 3
    with h5py.File(path) as file:
        for group in ("poses/camera", "poses/0001"):
            chunk = late[file[group].attrs["name"]]
            assert np.array_equal(file[group]["t"][-len(times_us) :], times_us)
            assert np.array_equal(file[group]["pose"][-len(times_us) :], chunk.poses)
        assert np.array_equal(file["imu/t"][-len(times_us) :], times_us)
        assert np.array_equal(file["imu/acceleration"][-len(times_us) :], samples.acceleration)
