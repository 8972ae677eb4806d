"""Truth in bags of ROS 1 and 2, under the names that ESIM gives its topics.

==================  ==========================================================================================
/cam0/events        as in bags without truth (`clsim.events.ros.bags`)
/cam0/image_raw     ``sensor_msgs/Image``, mono8: sRGB grey, one exposure for the run
/cam0/depthmap      ``sensor_msgs/Image``, 32FC1: metres along the optical axis, inf where nothing is
/cam0/optic_flow    ``esim_msgs/OpticFlow``: pixels per second, NaN where flow is unknown
/cam0/camera_info   ``sensor_msgs/CameraInfo``, with every frame; the first pixel's centre is at 0, 0
/cam0/pose, twist   ``geometry_msgs/PoseStamped`` in the world, ``TwistStamped`` in the camera's axes (OpenCV's)
/imu                ``sensor_msgs/Imu`` in the camera's axes, without orientation
==================  ==========================================================================================

Source: Rebecq et al., "ESIM: an Open Event Camera Simulator", CoRL 2018, and github.com/uzh-rpg/rpg_esim.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.events import EventBatch
from clsim.events.files import format_of
from clsim.events.formats.filesink import FlushPolicy, naming_failures
from clsim.events.ros.messages import stamp
from clsim.truth.record import About, ImuChunk, Layout, Shot, TrackChunk
from clsim.truth.writing.images import Pictures, with_images
from clsim.truth.writing.intrinsics import opencv_numbers
from clsim.truth.writing.poses import matrices

_FRAME, _WORLD = "cam0", "world"
_FLOW = "esim_msgs/msg/OpticFlow"
_FLOW_TEXT = "std_msgs/Header header\nuint32 height\nuint32 width\nfloat32[] flow_x\nfloat32[] flow_y\n"
_TOPICS = {
    "image": ("/cam0/image_raw", "sensor_msgs/msg/Image"),
    "depth": ("/cam0/depthmap", "sensor_msgs/msg/Image"),
    "flow": ("/cam0/optic_flow", _FLOW),
    "camera": ("/cam0/camera_info", "sensor_msgs/msg/CameraInfo"),
    "pose": ("/cam0/pose", "geometry_msgs/msg/PoseStamped"),
    "twist": ("/cam0/twist", "geometry_msgs/msg/TwistStamped"),
    "imu": ("/imu", "sensor_msgs/msg/Imu"),
}
_NO_ORIENTATION = np.array([-1.0, *[0.0] * 8])


class RosLayout(Layout):
    """Writes the bag; it gets its name when it is complete."""

    def __init__(self, path: Path, about: About) -> None:
        """Begin the bag; raises InputError when it cannot be."""
        from rosbags.typesys import get_types_from_msg

        kind = format_of(path)
        kind.check_library(path)
        self._about, self._path = about, path
        self._pictures = Pictures()
        self._sink: Any = kind.load().open_sink(path, about.width, about.height, FlushPolicy())
        self._bag = self._sink.bag
        self._types = self._bag.types
        self._types.register(get_types_from_msg(_FLOW_TEXT, _FLOW))
        told = {"image", "depth", "flow", "imu"} & set(with_images(about.names))
        self._wanted = (*told, "camera", *(("pose", "twist") if "poses" in about.names else ()))
        for name in sorted(self._wanted):
            self._bag.topic(*_TOPICS[name])

    def events(self, batch: EventBatch, end_us: int) -> None:
        """Append events."""
        self._sink.write(batch, end_us)

    def shot(self, shot: Shot) -> None:
        """Append a frame's images, and what the camera is like."""
        time_us, planes = shot.time_us, shot.planes
        self._write("camera", time_us, *self._camera_info())
        picture = self._pictures.of(planes)
        if picture is not None:
            self._write("image", time_us, *_image(picture, "mono8"))
        if "depth" in planes:
            self._write("depth", time_us, *_image(np.ascontiguousarray(planes["depth"], "<f4"), "32FC1"))
        if "flow" in planes:
            flow = planes["flow"]
            per_s = 1e6 / max(shot.after_us - time_us, 1)
            speed = np.where(flow[..., 2:3] > 0, flow[..., :2] * per_s, np.nan).astype(np.float32)
            height, width = speed.shape[:2]
            self._write("flow", time_us, height, width, speed[..., 0].ravel(), speed[..., 1].ravel())

    def track(self, chunk: TrackChunk) -> None:
        """Append the camera's poses and velocities."""
        if chunk.name != "camera":
            return
        linear = np.einsum("nij,ni->nj", matrices(chunk.poses)[:, :3, :3], chunk.velocities[:, :3])
        for time_us, pose, ahead, turn in zip(
            chunk.times_us.tolist(),
            chunk.poses.tolist(),
            linear.tolist(),
            chunk.velocities[:, 3:].tolist(),
            strict=True,
        ):
            place = self._make("geometry_msgs/msg/Point", *pose[:3])
            quaternion = self._make("geometry_msgs/msg/Quaternion", *pose[3:])
            self._write("pose", time_us, self._make("geometry_msgs/msg/Pose", place, quaternion), frame=_WORLD)
            twist = self._make("geometry_msgs/msg/Twist", self._vector(ahead), self._vector(turn))
            self._write("twist", time_us, twist)

    def imu(self, chunk: ImuChunk) -> None:
        """Append inertial samples."""
        unknown = np.zeros(9)
        nowhere = self._make("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0)
        for time_us, push, turn in zip(
            chunk.times_us.tolist(), chunk.acceleration.tolist(), chunk.angular_velocity.tolist(), strict=True
        ):
            turned, pushed = self._vector(turn), self._vector(push)
            self._write("imu", time_us, nowhere, _NO_ORIENTATION, turned, unknown, pushed, unknown)

    def close(self) -> None:
        """Complete the bag."""
        self._sink.close()

    def _camera_info(self) -> tuple[Any, ...]:
        about = self._about
        (fx, fy, cx, cy), distortion = opencv_numbers(about.camera)
        model = "equidistant" if about.camera["model"] == "fisheye" else "plumb_bob"
        k = np.array([fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0])
        p = np.array([fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0])
        region = self._make("sensor_msgs/msg/RegionOfInterest", 0, 0, 0, 0, False)
        d, r = np.array(distortion, np.float64), np.eye(3).ravel()
        return about.height, about.width, model, d, k, r, p, 0, 0, region

    def _write(self, name: str, time_us: int, *values: Any, frame: str = _FRAME) -> None:
        if name not in self._wanted:
            return
        topic, kind = _TOPICS[name]
        time = self._make("builtin_interfaces/msg/Time", *stamp(time_us))
        # ROS 1 numbers its headers, but nobody reads the numbers.
        header = self._make("std_msgs/msg/Header", *((0,) if self._bag.ros == 1 else ()), time, frame)
        serialise = self._types.serialize_ros1 if self._bag.ros == 1 else self._types.serialize_cdr
        with naming_failures(self._path):
            self._bag.write(topic, time_us, bytes(serialise(self._make(kind, header, *values), kind)))

    def _vector(self, values: Any) -> Any:
        return self._make("geometry_msgs/msg/Vector3", *values)

    def _make(self, kind: str, *values: Any) -> Any:
        return self._types.types[kind](*values)


def _image(pixels: npt.NDArray[Any], encoding: str) -> tuple[Any, ...]:
    height, width = pixels.shape
    data = np.frombuffer(pixels.tobytes(), np.uint8)
    return height, width, encoding, 0, width * pixels.itemsize, data


def is_recording(path: Path) -> bool:
    """Tell whether a file's truth can be read back: that of bags is for others."""
    return False


def open_layout(path: Path, about: About) -> RosLayout:
    """Begin a bag."""
    return RosLayout(path, about)
