"""TUM-VIE's layout: a folder of events in HDF5, grey pictures in JPEG, and text files of poses and inertial samples.

===================================  ==========================================================================
NAME-events_SIDE.h5                  as DSEC has them
SIDE_images/00000.jpg                8-bit sRGB grey, one exposure for the run, of JPEG's highest quality
SIDE_images/image_timestamps_SIDE.txt  a head, then µs a line
mocap_data.txt                       a head, then ``t px py pz qx qy qz qw``: camera to world; t in µs
imu_data.txt                         a head, then ``t gx gy gz ax ay az``: rad/s and m/s² in the camera's axes
camera-calibration.json              Basalt's: pinhole, pinhole-radtan8 or kb4; the first pixel's centre is at 0, 0
===================================  ==========================================================================

Pictures are of the event camera itself, for which JPEG is nearly, but not quite, exact.

Source: Klenk et al., TUM-VIE: The TUM Stereo Visual-Inertial Event Dataset, IROS 2021.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from clsim.events import EventBatch
from clsim.events.formats.filesink import FlushPolicy, naming_failures, unwritable
from clsim.events.formats.tables.hdf5 import Hdf5Sink, index_at, open_source
from clsim.truth.names import TRUTH_NAMES
from clsim.truth.record import About, ImuChunk, Layout, Shot, TrackChunk
from clsim.truth.recording import Recording
from clsim.truth.writing.images import Pictures, with_images
from clsim.truth.writing.intrinsics import camera_of, opencv_numbers
from clsim.truth.writing.lines import Lines, rate_of, read_table

_CALIBRATION = "camera-calibration.json"
_RADTAN8 = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
_QUALITY = 100


class TumVieLayout(Layout):
    """Writes the folder; several cameras of a rig may write into one, each to a side of its own."""

    def __init__(self, path: Path, about: About) -> None:
        """Create the folder; raises InputError when it cannot be."""
        self._path, self._side = path, about.side
        self._pictures, self._count = Pictures(), 0
        self._texts: dict[str, Lines] = {}
        names = with_images(about.names)
        try:
            path.mkdir(exist_ok=True)
            file = path / f"{path.name.removesuffix('.tumvie')}-events_{self._side}.h5"
            self._sink = Hdf5Sink(file, about.width, about.height, FlushPolicy())
            if "image" in names:
                (path / f"{self._side}_images").mkdir(exist_ok=True)
                text = path / f"{self._side}_images" / f"image_timestamps_{self._side}.txt"
                self._texts["image"] = Lines(text, "# timestamp [us]\n")
            # Poses, inertial samples and lens are those of the left camera alone.
            if self._side == "left":
                (path / _CALIBRATION).write_text(json.dumps(_calibration(about), indent=1) + "\n", encoding="utf-8")
                if "poses" in names:
                    self._texts["poses"] = Lines(path / "mocap_data.txt", "# t[us] px py pz[m] qx qy qz qw\n")
                if "imu" in names:
                    self._texts["imu"] = Lines(path / "imu_data.txt", "# t[us] gx gy gz[rad/s] ax ay az[m/s^2]\n")
        except OSError as error:
            raise unwritable(path, error) from None

    def events(self, batch: EventBatch, end_us: int) -> None:
        """Append events."""
        self._sink.write(batch, end_us)

    def shot(self, shot: Shot) -> None:
        """Write a frame's picture, then the line that tells of it."""
        picture = self._pictures.of(shot.planes)
        if picture is None:
            return
        with naming_failures(self._path):
            _write_jpeg(self._path / f"{self._side}_images" / f"{self._count:05d}.jpg", picture)
        self._texts["image"].add([f"{shot.time_us}"])
        self._count += 1

    def track(self, chunk: TrackChunk) -> None:
        """Append the camera's poses."""
        if chunk.name == "camera" and "poses" in self._texts:
            self._texts["poses"].add(_lines(chunk.times_us, chunk.poses))

    def imu(self, chunk: ImuChunk) -> None:
        """Append inertial samples."""
        if "imu" in self._texts:
            samples = np.concatenate([chunk.angular_velocity, chunk.acceleration], axis=1)
            self._texts["imu"].add(_lines(chunk.times_us, samples))

    def close(self) -> None:
        """Complete the files."""
        self._sink.close()
        for text in self._texts.values():
            text.close()


def _lines(times_us: npt.NDArray[np.int64], rows: npt.NDArray[np.float64]) -> Iterator[str]:
    for time_us, row in zip(times_us.tolist(), rows, strict=True):
        yield " ".join([str(time_us), *(f"{value:.12g}" for value in row)])


def _write_jpeg(path: Path, picture: npt.NDArray[np.uint8]) -> None:
    """Write a picture, which appears under its name when it is complete."""
    from PIL import Image

    part = path.with_name(f".{path.name}.part")
    Image.fromarray(picture).save(part, "JPEG", quality=_QUALITY)
    os.replace(part, path)


def _read_jpeg(path: Path) -> npt.NDArray[np.uint8]:
    from PIL import Image

    with Image.open(path, formats=("JPEG",)) as image:
        return np.array(image.convert("L"))


def _calibration(about: About) -> dict[str, Any]:
    """Return the left camera as Basalt tells it."""
    (fx, fy, cx, cy), coefficients = opencv_numbers(about.camera)
    numbers = {"fx": fx, "fy": fy, "cx": cx, "cy": cy}
    kind = "pinhole"
    if about.camera["model"] == "fisheye":
        kind, numbers = "kb4", numbers | dict(zip(("k1", "k2", "k3", "k4"), coefficients, strict=True))
    elif any(coefficients):
        padded = (*coefficients, 0.0, 0.0, 0.0)
        kind, numbers = "pinhole-radtan8", numbers | dict(zip(_RADTAN8, padded, strict=True))
    here = {"px": 0.0, "py": 0.0, "pz": 0.0, "qx": 0.0, "qy": 0.0, "qz": 0.0, "qw": 1.0}
    return {
        "value0": {
            "T_imu_cam": [here],
            "intrinsics": [{"camera_type": kind, "intrinsics": numbers}],
            "resolution": [[about.width, about.height]],
        }
    }


def _read_calibration(path: Path) -> dict[str, Any]:
    """Return the first camera of a calibration of Basalt's; raises KeyError or ValueError where it has none."""
    told = json.loads(path.read_text("utf-8-sig"))["value0"]
    kind, numbers = (told["intrinsics"][0][key] for key in ("camera_type", "intrinsics"))
    matrix = [float(numbers[key]) for key in ("fx", "fy", "cx", "cy")]
    keys = {"pinhole": (), "kb4": ("k1", "k2", "k3", "k4"), "pinhole-radtan8": _RADTAN8}
    if kind not in keys:
        raise ValueError(f"{path} has a camera {kind!r}, expected one of {', '.join(keys)}")
    coefficients = [float(numbers[key]) for key in keys[kind]]
    if any(coefficients[5:]):
        raise ValueError(f"{path} has k4 to k6, which clsim's lenses lack")
    width, height = map(int, told["resolution"][0])
    return camera_of((width, height), matrix, coefficients[:5], fisheye=kind == "kb4")


def is_recording(path: Path) -> bool:
    """Tell whether a folder is of this layout."""
    return len(list(path.glob("*-events_left.h5"))) == 1


def read_recording(path: Path) -> Recording:
    """Open a folder of this layout, the left camera; may raise anything where it is damaged."""
    (events,) = path.glob("*-events_left.h5")
    camera = _read_calibration(path / _CALIBRATION)
    texts = {"poses": path / "mocap_data.txt", "imu": path / "imu_data.txt"}
    pictures, stamps = path / "left_images", path / "left_images" / "image_timestamps_left.txt"
    names = {name for name, text in texts.items() if text.is_file()} | ({"image"} if stamps.is_file() else set())
    times = read_table(stamps, 1)[:, 0].astype(np.int64).tolist() if "image" in names else []
    about = About(
        width=camera["width"],
        height=camera["height"],
        camera=camera,
        names=tuple(name for name in TRUTH_NAMES if name in names),
        frame_rate=rate_of(times),
    )

    def shots() -> Iterator[Shot]:
        with h5py.File(events, "r") as file:
            for k, time_us in enumerate(times):
                planes = {"image": _read_jpeg(pictures / f"{k:05d}.jpg")}
                yield Shot(time_us, time_us, time_us, index_at(file, time_us), planes)

    def tracks() -> Iterator[TrackChunk]:
        if "poses" in names:
            table = read_table(texts["poses"], 8)
            unknown = np.full((len(table), 6), np.nan)
            yield TrackChunk("camera", table[:, 0].astype(np.int64), table[:, 1:], unknown)

    def imu() -> Iterator[ImuChunk]:
        if "imu" in names:
            table = read_table(texts["imu"], 7)
            yield ImuChunk(table[:, 0].astype(np.int64), table[:, 4:], table[:, 1:4])

    return Recording(about, lambda: iter(open_source(events)), shots=shots, tracks=tracks, imu=imu)


def open_layout(path: Path, about: About) -> TumVieLayout:
    """Open a writer of the layout."""
    return TumVieLayout(path, about)
