"""Layouts of data sets, read by programs that are not ours, and the ways between them."""

from __future__ import annotations

import json
import os
import shutil
import sys
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
import yaml

from clsim.errors import InputError
from clsim.scene.world import Lens
from clsim.truth.layouts import LAYOUTS, open_layout
from clsim.truth.recording import convert_recording, read_recording
from clsim.truth.writing.png import write_png
from tests.truth import recordings


def recorded(path: Path, lens: Lens | None = None) -> recordings.Given:
    return recordings.feed(open_layout(str(path), recordings.about(lens)))


@pytest.mark.parametrize("ending", [kind.endings[0] for kind in LAYOUTS if kind.calibrated])
def test_layouts_that_tell_intrinsics_refuse_parallel_rays_before_they_begin(tmp_path: Path, ending: str) -> None:
    with pytest.raises(InputError, match=f"run{ending}: needs intrinsics"):
        recorded(tmp_path / f"run{ending}", Lens(model="orthographic", view_width_m=2.0))
    assert not list(tmp_path.iterdir())


def test_tonic_reads_dsec(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cv2, tonic = pytest.importorskip("cv2"), pytest.importorskip("tonic")
    # It would reach for the net.
    reader = SimpleNamespace(plugins=SimpleNamespace(freeimage=SimpleNamespace(download=lambda: None)))
    monkeypatch.setitem(sys.modules, "imageio", reader)

    def by_opencv(self: object, path: str) -> np.ndarray:
        return cv2.imread(path, cv2.IMREAD_UNCHANGED)[..., ::-1]

    monkeypatch.setattr(tonic.datasets.DSEC, "_read_16bit_png", by_opencv)
    expected = recorded(tmp_path / "run.dsec")
    name = next(n for n, has_flow in tonic.datasets.DSEC.recordings["train"].items() if has_flow)
    ours, home = tmp_path / "run.dsec", tmp_path / "DSEC" / name
    home.mkdir(parents=True)
    for folder, place in {  # tonic unpacks each of DSEC's archives into a folder of its own
        "events_left": "events/left",
        "images_rectified_left": "images/left/rectified",
        "disparity_event": "disparity/event",
        "optical_flow_forward_event": "flow/forward",
    }.items():
        os.symlink(ours / place, home / folder)
    for folder, text in {
        "image_timestamps": "images/timestamps.txt",
        "disparity_timestamps": "disparity/timestamps.txt",
        "optical_flow_forward_timestamps": "flow/forward_timestamps.txt",
    }.items():
        (home / folder).mkdir()
        os.symlink(ours / text, home / folder / f"{name}_{folder}.txt")
    inputs = ["events_left", "images_rectified_left", "image_timestamps"]
    targets = ["disparity_event", "disparity_timestamps"]
    targets += ["optical_flow_forward_event", "optical_flow_forward_timestamps"]
    data = tonic.datasets.DSEC(str(tmp_path), name, inputs, targets)
    (events, images, image_times), (disparity, times, flow, spans) = data[0]
    events = events["events_left"]
    for ours_name, theirs in (("t", "t"), ("x", "x"), ("y", "y"), ("on", "p")):
        assert np.array_equal(events[theirs], expected.events[ours_name])
    frame_times = [shot.time_us for shot in expected.shots]
    assert image_times.tolist() == times.tolist() == frame_times
    assert spans.tolist() == [[t, t + recordings.STEP_US] for t in frame_times[:-1]]
    assert images.shape == (4, recordings.HEIGHT, recordings.WIDTH) and images.dtype == np.uint8
    for k, shot in enumerate(expected.shots):
        if k < len(spans):
            valid = shot.planes["flow"][..., 2] > 0
            assert np.array_equal(flow[k][..., 2] > 0, valid)
            assert np.abs(flow[k][..., :2] - shot.planes["flow"][..., :2])[valid].max() <= 0.5 / 128
        near = np.isfinite(shot.planes["depth"])
        focal = recordings.about().camera["intrinsics_px"]["fx"]
        d = disparity[k] / 256
        assert np.array_equal(d > 0, near)
        assert np.abs(focal * 0.1 / shot.planes["depth"][near] - d[near]).max() <= 0.5 / 256 + 1e-6


def test_calibration_is_yaml_that_leads_from_disparity_to_points(tmp_path: Path) -> None:
    recorded(tmp_path / "run.dsec", Lens(distortion=(0.1, -0.02, 1e-3, 2e-3, 0.0)))
    told = yaml.safe_load((tmp_path / "run.dsec/calibration/cam_to_cam.yaml").read_text())
    px = recordings.about().camera["intrinsics_px"]
    assert told["intrinsics"]["cam0"]["camera_matrix"] == [px["fx"], px["fy"], px["cx"] - 0.5, px["cy"] - 0.5]
    assert told["intrinsics"]["cam0"]["distortion_coeffs"] == [0.1, -0.02, 1e-3, 2e-3, 0.0]
    q = np.array(told["disparity_to_depth"]["cams_03"])
    x, y, depth_m = 7.0, 3.0, 2.5
    point = q @ (x, y, px["fx"] * 0.1 / depth_m, 1.0)
    point /= point[3]
    assert point[2] == pytest.approx(depth_m)
    assert point[0] == pytest.approx((x - (px["cx"] - 0.5)) * depth_m / px["fx"])
    assert point[1] == pytest.approx((y - (px["cy"] - 0.5)) * depth_m / px["fy"])


def test_rectification_is_the_identity(tmp_path: Path) -> None:
    recorded(tmp_path / "run.dsec")
    with h5py.File(tmp_path / "run.dsec/events/left/rectify_map.h5") as file:
        mapped = file["rectify_map"][:]
    assert mapped.shape == (recordings.HEIGHT, recordings.WIDTH, 2) and mapped[5, 9].tolist() == [9.0, 5.0]


def test_truth_of_a_rig_in_dsecs_layout_is_that_of_its_left_view(tmp_path: Path) -> None:
    """Both views go to one folder, and DSEC has disparity, flow and ids of the left alone."""
    truth = []
    for seed, side in enumerate(("left", "right")):
        recordings.feed(open_layout(str(tmp_path / "run.dsec"), recordings.about(side=side)), seed=seed)
        files = sorted((tmp_path / "run.dsec").rglob("*.png"))
        truth.append({file: file.read_bytes() for file in files if "images" not in file.parts})
    assert truth[0] == truth[1] and len(truth[0]) > 5


def test_tonic_reads_tum_vie(tmp_path: Path) -> None:
    """Both sides of a rig go to one folder; the reader wants it among its own downloads, from which it reads on."""
    tumvie = pytest.importorskip("tonic.datasets.tum_vie").TUMVIE
    names = tumvie.recordings
    home = tmp_path / "TUMVIE"
    home.mkdir()
    expected = recordings.feed(open_layout(str(tmp_path / "run.tumvie"), recordings.about(side="left")))
    right = recordings.feed(open_layout(str(tmp_path / "run.tumvie"), recordings.about(side="right")), seed=1)
    (tmp_path / "run.tumvie").rename(home / names[0])
    for side in ("left", "right"):
        (home / names[0] / f"run-events_{side}.h5").rename(home / names[0] / f"{names[0]}-events_{side}.h5")
    reader = object.__new__(tumvie)  # its constructor would download all the others
    reader.location_on_system, reader.selection = str(home), names[:1]
    reader.transform = reader.target_transform = reader.transforms = None
    data, targets = reader[0]
    for side, given_there in (("left", expected), ("right", right)):
        events = data[f"events_{side}"]
        for ours, theirs in (("t", "t"), ("x", "x"), ("y", "y"), ("on", "p")):
            assert np.array_equal(events[theirs], given_there.events[ours])
        shown = targets[f"images_{side}"]
        assert shown["ts"].tolist() == [shot.time_us for shot in given_there.shots]
        for shot in given_there.shots:  # the reader does not sort the files
            assert np.abs(shown["frames"].astype(int) - shot.planes["image"]).max(axis=(1, 2)).min() <= 3
    assert np.array_equal(data["imu"][:, 0], expected.imu.times_us)
    assert np.abs(data["imu"][:, 1:4] - expected.imu.angular_velocity).max() < 1e-9
    assert np.abs(data["imu"][:, 4:] - expected.imu.acceleration).max() < 1e-9
    assert np.array_equal(targets["mocap"][:, 0], expected.tracks["camera"].times_us)
    assert np.abs(targets["mocap"][:, 1:] - expected.tracks["camera"].poses).max() < 1e-9


@pytest.mark.parametrize(
    "lens",
    [
        Lens(),
        Lens(distortion=(0.1, -0.02, 1e-3, 2e-3, 0.05)),
        Lens(distortion=(0.0, 0.0, 0.0, 2e-3, 0.0)),
        Lens(distortion=(0.0, 0.0, 0.0, 0.0, 0.05)),
        Lens(model="fisheye", distortion=(0.02, -0.01, 0, 0)),
    ],
    ids=["plain", "distorted", "tangential alone", "k3 alone", "fisheye"],
)
def test_basalts_calibration_comes_back(tmp_path: Path, lens: Lens) -> None:
    recorded(tmp_path / "run.tumvie", lens)
    camera = read_recording(str(tmp_path / "run.tumvie")).about.camera
    given_camera = recordings.about(lens).camera
    assert camera["model"] == given_camera["model"] and camera["distortion"] == given_camera["distortion"]
    assert camera["intrinsics_px"] == pytest.approx(given_camera["intrinsics_px"])
    told = json.loads((tmp_path / "run.tumvie/camera-calibration.json").read_text())["value0"]
    assert told["intrinsics"][0]["intrinsics"]["cx"] == given_camera["intrinsics_px"]["cx"] - 0.5
    here = dict.fromkeys(("px", "py", "pz", "qx", "qy", "qz"), 0.0) | {"qw": 1.0}
    assert told["T_imu_cam"] == [here], "samples are in the camera's own axes"


@pytest.mark.parametrize("name", ["k4", "k5", "k6"])
def test_a_distortion_that_clsims_lenses_lack_is_refused(tmp_path: Path, name: str) -> None:
    recorded(tmp_path / "run.tumvie", Lens(distortion=(0.1, -0.02, 1e-3, 2e-3, 0.05)))
    path = tmp_path / "run.tumvie/camera-calibration.json"
    told = json.loads(path.read_text())
    told["value0"]["intrinsics"][0]["intrinsics"][name] = 0.01
    path.write_text(json.dumps(told))
    with pytest.raises(InputError, match="has k4 to k6, which clsim's lenses lack"):
        read_recording(str(tmp_path / "run.tumvie"))


@pytest.mark.parametrize("name", ["run.tum", "run.ecd"])
def test_evo_reads_trajectories(tmp_path: Path, name: str) -> None:
    file_interface = pytest.importorskip("evo.tools.file_interface")
    expected = recorded(tmp_path / name).tracks["camera"]
    path = tmp_path / name
    trajectory = file_interface.read_tum_trajectory_file(path / "groundtruth.txt" if path.is_dir() else path)
    assert np.abs(trajectory.timestamps - expected.times_us * 1e-6).max() < 1e-9
    assert np.abs(trajectory.positions_xyz - expected.poses[:, :3]).max() < 1e-8
    assert np.abs(trajectory.orientations_quat_wxyz - expected.poses[:, [6, 3, 4, 5]]).max() < 1e-11
    assert trajectory.check()[0]


def test_ecd_is_text_for_numpy_and_pictures_for_pillow(tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image")
    expected = recorded(tmp_path / "run.ecd", Lens(distortion=(0.1, -0.02, 1e-3, 2e-3, 0.05)))
    folder = tmp_path / "run.ecd"
    events = np.loadtxt(folder / "events.txt")
    assert np.array_equal(np.rint(events[:, 0] * 1e6), expected.events["t"])
    assert np.array_equal(events[:, 1:3], np.stack([expected.events["x"], expected.events["y"]], axis=1))
    assert np.array_equal(events[:, 3], expected.events["on"])
    assert np.loadtxt(folder / "calib.txt")[4:].tolist() == [0.1, -0.02, 1e-3, 2e-3, 0.05]
    imu = np.loadtxt(folder / "imu.txt")
    assert np.abs(imu[:, 1:4] - expected.imu.acceleration).max() < 1e-6
    assert np.abs(imu[:, 4:] - expected.imu.angular_velocity).max() < 1e-6
    lines = [line.split() for line in (folder / "images.txt").read_text().splitlines()]
    assert [round(float(t) * 1e6) for t, _ in lines] == [shot.time_us for shot in expected.shots]
    shown = [np.asarray(image.open(folder / name)) for _, name in lines]
    assert all(each.shape == (recordings.HEIGHT, recordings.WIDTH) and each.dtype == np.uint8 for each in shown)
    brightness = np.concatenate([shot.planes["intensity"].ravel() for shot in expected.shots])
    order = np.argsort(brightness)
    assert (np.diff(np.concatenate([each.ravel() for each in shown])[order].astype(int)) >= 0).all(), "one exposure"
    with pytest.raises(InputError, match="no fisheye"):
        open_layout(str(tmp_path / "other.ecd"), recordings.about(Lens(model="fisheye")))


def test_mvsec_is_as_its_users_read_it(tmp_path: Path) -> None:
    expected = recorded(tmp_path / "run.mvsec")
    folder = tmp_path / "run.mvsec"
    with h5py.File(folder / "run_data.hdf5") as data, h5py.File(folder / "run_gt.hdf5") as truth:
        events = data["davis/left/events"][:]
        assert np.array_equal(np.rint(events[:, 2] * 1e6), expected.events["t"])
        assert np.array_equal(events[:, 3], np.where(expected.events["on"], 1, -1))
        indices = data["davis/left/image_raw_event_inds"][:]
        assert indices.tolist() == [shot.event_index for shot in expected.shots]
        depth = truth["davis/left/depth_image_raw"][:]
        given_depth = np.stack([shot.planes["depth"] for shot in expected.shots])
        assert np.array_equal(np.isnan(depth), np.isinf(given_depth))
        assert np.array_equal(depth[np.isfinite(depth)], given_depth[np.isfinite(given_depth)])
        assert np.array_equal(truth["davis/left/depth_image_rect"][:], depth, equal_nan=True)
        pose = truth["davis/left/pose"][:]
        assert np.abs(pose[:, :3, 3] - expected.tracks["camera"].poses[:, :3]).max() < 1e-12
        assert np.abs(pose[:, :3, :3] @ np.swapaxes(pose[:, :3, :3], 1, 2) - np.eye(3)).max() < 1e-12
    flow = np.load(folder / "run_gt_flow_dist.npz")
    assert flow["timestamps"].tolist() == [shot.time_us * 1e-6 for shot in expected.shots]
    for axis, name in enumerate(("x_flow_dist", "y_flow_dist")):
        for shown, shot in zip(flow[name], expected.shots, strict=True):
            known = shot.planes["flow"][..., 2] > 0
            assert np.array_equal(shown, np.where(known, shot.planes["flow"][..., axis], 0))


def original_dsec(path: Path, block_style: bool) -> recordings.Given:
    """A sequence as DSEC publishes it: nothing beyond, numbers left out, images of another camera."""
    source = path / "made.dsec"
    expected = recorded(source)
    home = path / "zurich_city_00_a.dsec"
    shutil.copytree(source / "events", home / "events")
    for folder in ("disparity/event", "flow/forward", "images/left/rectified"):
        (home / folder).mkdir(parents=True)
        for k, file in enumerate(sorted((source / folder).iterdir())):
            shutil.copy(file, home / folder / f"{2 * k:06d}.png")
    for text in ("disparity/timestamps.txt", "flow/forward_timestamps.txt", "images/timestamps.txt"):
        shutil.copy(source / text, home / text)
    for file in (home / "images/left/rectified").iterdir():
        write_png(file, np.zeros((30, 40, 3), np.uint8))
    with h5py.File(home / "events/left/rectify_map.h5", "r+") as file:
        file["rectify_map"][...] += 1.5
    focal = recordings.about().camera["intrinsics_px"]["fx"]

    def camera(size: tuple[int, int], scale: float) -> dict[str, object]:
        return {"camera_matrix": [scale * focal, scale * focal, 11.5, 7.5], "camera_model": "pinhole"} | {
            "distortion_coeffs": [0.0, 0.0, 0.0, 0.0], "distortion_model": "radtan", "resolution": list(size)
        }  # fmt: skip

    told = {
        "disparity_to_depth": {
            "cams_03": [[1, 0, 0, -11.5], [0, 1, 0, -7.5], [0, 0, 0, focal], [0, 0, 10.0, 0]],
            "cams_12": [[1, 0, 0, -1.5], [0, 1, 0, -1.5], [0, 0, 0, 9.0], [0, 0, 3.0, 0]],
        },
        "extrinsics": {"R_rect0": np.eye(3).tolist(), "T_10": np.eye(4).tolist()},
        "intrinsics": {
            "cam0": camera((recordings.WIDTH, recordings.HEIGHT), 1.1),
            "cam1": camera((1440, 1080), 3.0),
            "camRect0": camera((recordings.WIDTH, recordings.HEIGHT), 1.0),
            "camRect1": camera((1440, 1080), 2.9),
        },
    }
    (home / "calibration").mkdir()
    text = yaml.safe_dump(told, default_flow_style=False if block_style else None)
    (home / "calibration/cam_to_cam.yaml").write_text(text)
    shutil.rmtree(source)
    return expected


@pytest.mark.parametrize("block_style", [False, True])
def test_a_sequence_of_dsecs_own_is_read(tmp_path: Path, block_style: bool) -> None:
    expected = original_dsec(tmp_path, block_style)
    recording = read_recording(str(tmp_path / "zurich_city_00_a.dsec"))
    assert recording.about.names == ("depth", "flow") and recording.about.width == recordings.WIDTH
    assert recording.about.baseline_m == pytest.approx(0.1)
    focal = recordings.about().camera["intrinsics_px"]["fx"]
    assert recording.about.camera["intrinsics_px"] == pytest.approx({"fx": focal, "fy": focal, "cx": 12.0, "cy": 8.0})
    for shot, given_shot in zip(recording.shots(), expected.shots, strict=True):
        near = np.isfinite(given_shot.planes["depth"])
        assert np.array_equal(np.isfinite(shot.planes["depth"]), near)
        disparity = focal * 0.1 / shot.planes["depth"][near], focal * 0.1 / given_shot.planes["depth"][near]
        assert np.abs(disparity[0] - disparity[1]).max() <= 0.5 / 256 + 1e-5
        assert shot.time_us == given_shot.time_us
        # The last frame's would lead beyond the recording.
        assert ("flow" in shot.planes) == (given_shot is not expected.shots[-1])
        if "flow" in shot.planes:
            valid = shot.planes["flow"][..., 2] > 0
            off = np.abs(shot.planes["flow"][..., :2] - given_shot.planes["flow"][..., :2])[valid]
            assert off.max() <= 0.5 / 128 and shot.after_us == given_shot.after_us
    count, left_out = convert_recording(str(tmp_path / "zurich_city_00_a.dsec"), str(tmp_path / "own.h5"))
    assert count == len(expected.events) and not left_out


@pytest.mark.parametrize("ending", [".h5", ".dsec", ".mvsec"])
def test_frames_that_lack_a_plane_keep_their_own_of_the_others(tmp_path: Path, ending: str) -> None:
    """DSEC has flow for fewer frames than disparity: what is known at a time is told for that time, and no more."""
    original_dsec(tmp_path, False)
    home = tmp_path / "zurich_city_00_a.dsec"
    for folder, text, gone in (
        ("flow/forward", "flow/forward_timestamps.txt", 1),
        ("disparity/event", "disparity/timestamps.txt", 2),
    ):
        sorted((home / folder).iterdir())[gone].unlink()
        lines = (home / text).read_text().splitlines(keepends=True)
        del lines[gone + sum(line.startswith("#") for line in lines)]
        (home / text).write_text("".join(lines))
    expected = {shot.time_us: shot for shot in read_recording(str(home)).shots()}
    convert_recording(str(home), str(tmp_path / f"other{ending}"))
    found = {shot.time_us: shot for shot in read_recording(str(tmp_path / f"other{ending}")).shots()}
    assert len(expected) == 4 and set(found) == set(expected)
    for time_us, shot in expected.items():
        flow = found[time_us].planes.get("flow", np.zeros(1))
        assert ("flow" in shot.planes) == bool((flow[..., 2:3] > 0).any())
        if "flow" in shot.planes:
            np.testing.assert_array_equal(flow[..., :3], shot.planes["flow"][..., :3])
        depth = found[time_us].planes.get("depth", np.full(1, np.nan))
        assert ("depth" in shot.planes) == bool(np.isfinite(depth).any())
        if "depth" in shot.planes:
            np.testing.assert_allclose(depth, shot.planes["depth"], rtol=1e-3)


@pytest.mark.parametrize("calibrated", ["", "equidistant", "radtan"])
def test_a_sequence_of_mvsecs_own_is_read(tmp_path: Path, calibrated: str) -> None:
    """No camera in the file, flow in the npz alone and at times of its own, pictures at others, epoch's seconds."""
    expected = recorded(tmp_path / "made.mvsec")
    start_s, shots = 1.5e9, expected.shots
    expected.events["t"][shots[1].event_index] = shots[1].time_us  # one at a frame's very time
    home = tmp_path / "outdoor_day1.mvsec"
    home.mkdir()
    t = expected.events["t"] * 1e-6 + start_s
    with h5py.File(home / "outdoor_day1_data.hdf5", "w") as data, h5py.File(home / "outdoor_day1_gt.hdf5", "w") as gt:
        e = expected.events
        data["davis/left/events"] = np.stack([e["x"], e["y"], t, np.where(e["on"], 1, -1)], axis=1)
        data["davis/left/image_raw"] = np.stack([shot.planes["image"] for shot in shots])
        data["davis/left/image_raw_ts"] = [start_s + shot.time_us * 1e-6 + 0.011 for shot in shots]
        data["davis/left/image_raw_event_inds"] = [shot.event_index for shot in shots]
        gt["davis/left/depth_image_raw"] = np.stack([shot.planes["depth"] for shot in shots])
        gt["davis/left/depth_image_raw_ts"] = [start_s + shot.time_us * 1e-6 for shot in shots]
        gt["davis/left/pose"] = np.tile(np.eye(4), (3, 1, 1))
        gt["davis/left/pose_ts"] = start_s + np.arange(3) * 0.05
    flows = np.stack([np.where(s.planes["flow"][..., 2:3] > 0, s.planes["flow"], 0) for s in shots]).astype(np.float64)
    np.savez(
        home / "outdoor_day1_gt_flow_dist.npz",
        timestamps=np.array([start_s + shot.time_us * 1e-6 for shot in shots]),
        x_flow_dist=flows[..., 0],
        y_flow_dist=flows[..., 1],
    )
    if calibrated:
        (home / "camchain-imucam-outdoor_day1.yaml").write_text(
            "cam0:\n  camera_model: pinhole\n  distortion_coeffs: [-0.03, 0.01, -0.02, 0.002]\n"
            f"  distortion_model: {calibrated}\n  intrinsics: [226.4, 226.2, 173.6, 133.7]\n"
            f"  resolution: [{recordings.WIDTH}, {recordings.HEIGHT}]\n"
            f"cam1:\n  distortion_model: {'radtan' if calibrated == 'equidistant' else 'equidistant'}\n"
            "  intrinsics: [1, 2, 3, 4]\n  resolution: [9, 9]\n"
        )
    recording = read_recording(str(home))
    assert recording.about.names == ("image", "depth", "flow", "poses")
    assert (recording.about.width, recording.about.height) == (recordings.WIDTH, recordings.HEIGHT)
    found = list(recording.shots())
    assert [shot.time_us for shot in found] == sorted(shot.time_us for shot in found) and len(found) == 2 * len(shots)
    origin_us = round(start_s * 1e6)
    for shot in found:
        assert shot.event_index == np.count_nonzero(expected.events["t"] < shot.time_us - origin_us)
    assert shots[1].time_us + origin_us in [shot.time_us for shot in found]
    truths = [shot for shot in found if "flow" in shot.planes]
    for shot, given_shot, flow in zip(truths, shots, flows, strict=True):
        assert np.array_equal(shot.planes["depth"], given_shot.planes["depth"])
        assert np.array_equal(shot.planes["flow"][..., :2], flow[..., :2].astype(np.float32))
        assert abs(shot.after_us - shot.time_us - recordings.STEP_US) <= 1 and "image" not in shot.planes
    assert np.array_equal(np.concatenate(list(recording.events()))["t"] - origin_us, expected.events["t"])
    target = str(tmp_path / "other.ecd")
    if calibrated:
        assert recording.about.camera["intrinsics_px"]["cx"] == 174.1
        assert recording.about.camera["model"] == ("fisheye" if calibrated == "equidistant" else "perspective")
    else:
        with pytest.raises(InputError, match="needs the camera's intrinsics"):
            convert_recording(str(home), target)
    convert_recording(str(home), str(tmp_path / "own.h5"))
