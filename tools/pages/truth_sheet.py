"""Draw events, image, depth, flow, ids and inertial samples of a recording with truth: docs/images/ground-truth.png.

python tools/pages/truth_sheet.py run.h5 docs/images/ground-truth.png
"""

from __future__ import annotations

import sys

import h5py
import matplotlib.pyplot as plt
import numpy as np

import clsim
from clsim.live.view.accumulate import colour_indices, signed_image
from clsim.live.view.colormaps import lut
from clsim.live.view.truth_pictures import FlowPicture, recorded_pictures


def colour_wheel(side: int = 61) -> np.ndarray:
    """What each direction of flow looks like, at full strength on the rim."""
    y, x = np.mgrid[:side, :side] - (side - 1) / 2
    inside = np.hypot(x, y) <= side / 2
    picture = FlowPicture()(np.stack([x, y], axis=-1), inside, inside)
    picture[~inside] = 255
    return picture


def main() -> None:
    """Draw the middle frame."""
    name, out = sys.argv[1:]
    with h5py.File(name) as file:
        times = file["frames/t"][:]
        k = len(times) // 2
        height, width = file["frames/depth"].shape[1:]
        imu = {key: file["imu"][key][:] for key in file["imu"]}
    events = clsim.open(name).read()
    half_us = int(np.diff(times)[0]) // 2
    near = events[np.abs(events["t"] - times[k]) < half_us]
    shown = {"events within 1/60 s": lut(theme="light")[colour_indices(signed_image(near, width, height), 2.0)]}
    for title, what in (("intensity", "image"), ("depth", "depth"), ("flow", "flow"), ("objects", "ids")):
        shown[title] = list(recorded_pictures(name, what))[k][1]
    figure, places = plt.subplots(2, 3, figsize=(12, 6.4), constrained_layout=True)
    for place, (title, picture) in zip(places.flat, shown.items(), strict=False):
        place.imshow(picture)
        place.set_title(title)
        place.set_axis_off()
    wheel = places.flat[3].inset_axes((0.86, 0.0, 0.14, 0.2))
    wheel.imshow(colour_wheel())
    wheel.set_axis_off()
    place = places.flat[5]
    for axis, label in enumerate("xyz"):
        place.plot(imu["t"] * 1e-6, imu["acceleration"][:, axis], label=f"force {label} [m/s²]")
        place.plot(imu["t"] * 1e-6, 10 * imu["angular_velocity"][:, axis], "--", label=f"10 × rate {label} [rad/s]")
    place.axvline(times[k] * 1e-6, color="0.7")
    place.set_title("inertial samples, 1 kHz")
    place.set_xlabel("s")
    place.legend(fontsize=6, ncols=2)
    figure.savefig(out, dpi=80)


if __name__ == "__main__":
    main()
