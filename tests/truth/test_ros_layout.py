"""Truth in bags of ROS, read by rosbags and by mcap-ros2-support."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from clsim.events.files import open_source
from clsim.scene.world import Lens
from clsim.truth.layouts import open_layout
from clsim.truth.writing.poses import matrices
from tests.truth import recordings


def topics_of(path: Path) -> dict[str, list[Any]]:
    from rosbags.highlevel import AnyReader

    found: dict[str, list[Any]] = {}
    with AnyReader([path]) as reader:
        for connection, time_ns, raw in reader.messages():
            found.setdefault(connection.topic, []).append((time_ns, reader.deserialize(raw, connection.msgtype)))
    return found


@pytest.mark.parametrize("ending", [".mcap", ".db3", ".bag"])
def test_rosbags_reads_everything_under_the_names_of_esim(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"run{ending}"
    given = recordings.feed(open_layout(str(path), recordings.about()))
    topics = topics_of(path)
    for (time_ns, image), shot in zip(topics["/cam0/image_raw"], given.shots, strict=True):
        assert time_ns == shot.time_us * 1000
        assert (image.encoding, image.step, image.header.frame_id) == ("mono8", recordings.WIDTH, "cam0")
        assert np.array_equal(np.reshape(image.data, (recordings.HEIGHT, -1)), shot.planes["image"])
    for (_, image), shot in zip(topics["/cam0/depthmap"], given.shots, strict=True):
        depth = np.asarray(image.data, np.uint8).view("<f4").reshape(recordings.HEIGHT, recordings.WIDTH)
        assert (image.encoding, image.step) == ("32FC1", 4 * recordings.WIDTH)
        assert np.array_equal(depth, shot.planes["depth"])
    for (_, flow), shot in zip(topics["/cam0/optic_flow"], given.shots, strict=True):
        valid = (shot.planes["flow"][..., 2] > 0).ravel()
        for axis, found in enumerate(map(np.asarray, (flow.flow_x, flow.flow_y))):
            assert np.array_equal(np.isfinite(found), valid)
            expected = shot.planes["flow"][..., axis].ravel()[valid] * 1e6 / recordings.STEP_US
            np.testing.assert_allclose(found[valid], expected, rtol=1e-5)
    camera = given.tracks["camera"]
    poses = topics["/cam0/pose"]
    assert [time_ns for time_ns, _ in poses] == (camera.times_us * 1000).tolist()
    for (_, message), row in zip(poses, camera.poses, strict=True):
        at, turn = message.pose.position, message.pose.orientation
        np.testing.assert_allclose([at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w], row)
        assert message.header.frame_id == "world"
    for (_, message), row, pose in zip(topics["/cam0/twist"], camera.velocities, matrices(camera.poses), strict=True):
        ahead, turn = message.twist.linear, message.twist.angular
        np.testing.assert_allclose(pose[:3, :3] @ [ahead.x, ahead.y, ahead.z], row[:3], atol=1e-12)
        np.testing.assert_allclose([turn.x, turn.y, turn.z], row[3:])
    assert given.imu is not None
    for (_, message), push, turn in zip(
        topics["/imu"], given.imu.acceleration, given.imu.angular_velocity, strict=True
    ):
        a, w = message.linear_acceleration, message.angular_velocity
        np.testing.assert_allclose([a.x, a.y, a.z, w.x, w.y, w.z], [*push, *turn])
        assert message.orientation_covariance[0] == -1
    with open_source(path) as source:
        assert np.array_equal(source.read(), given.events)


def test_mcap_ros2_reads_the_camera(tmp_path: Path) -> None:
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    path = tmp_path / "run.mcap"
    lens = Lens(distortion=(0.1, -0.05, 0.01, 0.02, 0.003))
    recordings.feed(open_layout(str(path), recordings.about(lens)))
    pixels = recordings.about(lens).camera["intrinsics_px"]
    with path.open("rb") as file:
        found = list(
            make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(["/cam0/camera_info"])
        )
    assert len(found) == recordings.SHOTS
    info = found[0][3]
    assert (info.width, info.height, info.distortion_model) == (recordings.WIDTH, recordings.HEIGHT, "plumb_bob")
    np.testing.assert_allclose(
        [info.k[i] for i in (0, 2, 4, 5)], [pixels["fx"], pixels["cx"] - 0.5, pixels["fy"], pixels["cy"] - 0.5]
    )
    np.testing.assert_allclose(list(info.d), lens.distortion)


def test_only_what_is_asked_for_is_written(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    recordings.feed(open_layout(str(path), recordings.about(names=("depth",))))
    assert {topic for topic, found in topics_of(path).items() if found} >= {"/cam0/depthmap", "/cam0/camera_info"}
    assert "/imu" not in topics_of(path)
