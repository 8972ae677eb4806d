"""Draw what another reader finds in a bag of clsim, topic by topic: docs/images/ros.png.

clsim live two-boxes --resolution 173x130 --truth image,depth,flow,poses,imu --frame-rate 30 --out run.mcap
python tools/pages/ros_picture.py run.mcap docs/images/ros.png

The bag is read with mcap and mcap-ros2-support, by the definitions that are in it.
"""

from __future__ import annotations

import sys
from collections import defaultdict
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from mcap_ros2.reader import read_ros2_messages


def seconds(message: Any) -> float:
    return message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec


def grid(message: Any, dtype: str) -> np.ndarray:
    return np.frombuffer(message.data, dtype).reshape(message.height, message.width)


def events_of(packet: Any) -> tuple[np.ndarray, ...]:
    """Return the columns, rows and polarities of a packet in encoding mono."""
    words = np.frombuffer(packet.events, "<u8")
    return (words >> 32 & 0xFFFF).astype(int), (words >> 48 & 0x7FFF).astype(int), words >> 63 == 1


def main() -> None:
    """Draw the middle frame, and all poses and inertial samples."""
    recording, target = sys.argv[1:]
    told: dict[str, list[Any]] = defaultdict(list)
    for each in read_ros2_messages(recording):
        told[each.channel.topic].append(each.ros_msg)
    image = told["/cam0/image_raw"][len(told["/cam0/image_raw"]) // 2]
    near = {
        topic: min(messages, key=lambda each: abs(seconds(each) - seconds(image))) for topic, messages in told.items()
    }
    flow = near["/cam0/optic_flow"]
    speed = np.hypot(*(np.reshape(each, (flow.height, flow.width)) for each in (flow.flow_x, flow.flow_y)))
    seen = np.full((image.height, image.width, 3), 255, np.uint8)
    for packet in told["/cam0/events"]:
        if 0 <= seconds(packet) - seconds(image) < 0.02:
            x, y, on = events_of(packet)
            seen[y, x] = np.where(on[:, None], (200, 40, 30), (40, 70, 200))

    figure, places = plt.subplots(2, 3, figsize=(12, 6.4), layout="constrained")
    pictures = {
        "/cam0/events, 20 ms": (seen, {}),
        "/cam0/image_raw": (grid(image, "u1"), {"cmap": "gray"}),
        "/cam0/depthmap [m]": (grid(near["/cam0/depthmap"], "<f4"), {"cmap": "viridis"}),
        "/cam0/optic_flow, speed [px/s]": (speed, {"cmap": "magma"}),
    }
    for place, (title, (picture, options)) in zip(places.flat, pictures.items(), strict=False):
        shown = place.imshow(picture, **options)
        if picture.dtype != np.uint8:
            figure.colorbar(shown, ax=place)
        place.set_title(title, fontsize=10)
        place.set_axis_off()
    poses, samples = told["/cam0/pose"], told["/imu"]
    for axis in "xyz":
        places[1, 1].plot([seconds(p) for p in poses], [getattr(p.pose.position, axis) for p in poses], label=axis)
        turn = [getattr(sample.angular_velocity, axis) for sample in samples]
        places[1, 2].plot([seconds(sample) for sample in samples], turn, label=axis)
    for place, title in ((places[1, 1], "/cam0/pose, position [m]"), (places[1, 2], "/imu, angular velocity [rad/s]")):
        place.set_title(title, fontsize=10)
        place.set_xlabel("s")
        place.legend()
    figure.savefig(target, dpi=90)


if __name__ == "__main__":
    main()
