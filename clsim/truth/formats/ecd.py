"""The text layout of the Event-Camera Dataset: a folder that needs no library to be read.

==================  ==========================================================================================
events.txt          ``t x y p`` a line, t in seconds
images.txt          ``t images/frame_00000000.png`` a line; 8-bit sRGB grey, one exposure for the run
depthmaps.txt       ``t depthmaps/frame_00000000.exr`` a line; metres along the optical axis, inf where nothing is
groundtruth.txt     ``t px py pz qx qy qz qw`` a line: camera to world, OpenCV's axes
imu.txt             ``t ax ay az gx gy gz`` a line: m/s² and rad/s in the camera's axes
calib.txt           ``fx fy cx cy k1 k2 p1 p2 k3``; the first pixel's centre is at 0, 0
==================  ==========================================================================================

Source: Mueggler et al., The Event-Camera Dataset and Simulator, IJRR 2017.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.events import EventBatch
from clsim.events.formats.filesink import FlushPolicy, naming_failures, unwritable
from clsim.events.formats.tables.text import open_sink, open_source
from clsim.truth.names import TRUTH_NAMES
from clsim.truth.record import About, ImuChunk, Layout, Shot, TrackChunk
from clsim.truth.recording import Recording
from clsim.truth.writing.images import Pictures, with_images
from clsim.truth.writing.intrinsics import camera_of, opencv_numbers
from clsim.truth.writing.lines import (
    Lines,
    imu_lines,
    rate_of,
    read_files,
    read_imu,
    read_table,
    read_track,
    seconds,
    tum_lines,
)
from clsim.truth.writing.png import read_png, write_png


class EcdLayout(Layout):
    """Writes the folder."""

    def __init__(self, path: Path, about: About) -> None:
        """Create the folder; raises InputError when it cannot be, or for a fisheye, which calib.txt cannot tell."""
        camera = about.camera
        if camera.get("model") == "fisheye":
            raise InputError(f"{path}: ECD's calibration knows no fisheye; expected another layout")
        self._path, self._count = path, 0
        self._pictures = Pictures()
        self._texts: dict[str, Lines] = {}
        try:
            path.mkdir(exist_ok=True)
            self._sink = open_sink(path / "events.txt", about.width, about.height, FlushPolicy(), time_unit="s")
            numbers, coefficients = opencv_numbers(camera)
            (path / "calib.txt").write_text(" ".join(f"{v:.12g}" for v in (*numbers, *coefficients)) + "\n")
            for name, text, folder in (
                ("image", "images.txt", "images"),
                ("depth", "depthmaps.txt", "depthmaps"),
                ("poses", "groundtruth.txt", None),
                ("imu", "imu.txt", None),
            ):
                if name in with_images(about.names):
                    self._texts[text] = Lines(path / text)
                    if folder is not None:
                        (path / folder).mkdir(exist_ok=True)
        except OSError as error:
            raise unwritable(path, error) from None

    def events(self, batch: EventBatch, end_us: int) -> None:
        """Append events."""
        self._sink.write(batch, end_us)

    def shot(self, shot: Shot) -> None:
        """Write a frame's files, then the lines that tell of them."""
        number = f"frame_{self._count:08d}"
        with naming_failures(self._path):
            picture = self._pictures.of(shot.planes)
            if picture is not None:
                write_png(self._path / "images" / f"{number}.png", picture)
                self._texts["images.txt"].add([f"{seconds(shot.time_us)} images/{number}.png"])
            if "depth" in shot.planes:
                write_depth(self._path / "depthmaps" / f"{number}.exr", shot.planes["depth"])
                self._texts["depthmaps.txt"].add([f"{seconds(shot.time_us)} depthmaps/{number}.exr"])
        self._count += 1

    def track(self, chunk: TrackChunk) -> None:
        """Append the camera's poses."""
        if chunk.name == "camera" and "groundtruth.txt" in self._texts:
            self._texts["groundtruth.txt"].add(tum_lines(chunk))

    def imu(self, chunk: ImuChunk) -> None:
        """Append inertial samples."""
        if "imu.txt" in self._texts:
            self._texts["imu.txt"].add(imu_lines(chunk))

    def close(self) -> None:
        """Complete the files."""
        self._sink.close()
        for text in self._texts.values():
            text.close()


def write_depth(path: Path, depth_m: npt.NDArray[np.float32]) -> None:
    """Write an EXR file with the channel ``Z``; it appears under its name when it is complete."""
    import OpenEXR

    part = path.with_name(f".{path.name}.part")
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    try:
        with OpenEXR.File(header, {"Z": np.ascontiguousarray(depth_m)}) as file:
            file.write(str(part))
    except RuntimeError as error:
        raise OSError(str(error)) from None
    os.replace(part, path)


def read_depth(path: Path) -> npt.NDArray[np.float32]:
    """Read the channel ``Z`` of an EXR file; raises ValueError where it has none."""
    import OpenEXR

    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = file.channels()
        if "Z" not in channels:
            raise ValueError(f"{path} has no channel Z")
        return np.array(channels["Z"].pixels, np.float32)


def is_recording(path: Path) -> bool:
    """Tell whether a folder is of this layout."""
    return (path / "events.txt").is_file() and (path / "calib.txt").is_file()


def read_recording(path: Path) -> Recording:
    """Open a folder of this layout; may raise anything where it is damaged."""
    images, depths = (
        read_files(path / text) if (path / text).is_file() else {} for text in ("images.txt", "depthmaps.txt")
    )
    texts = {"poses": path / "groundtruth.txt", "imu": path / "imu.txt"}
    there = {name: file for name, file in texts.items() if file.is_file()}
    names = {*there, *(["image"] if images else []), *(["depth"] if depths else [])}
    times = sorted({*images, *depths})
    numbers = read_table(path / "calib.txt", 9)[0].tolist()
    size = _size(path, images, depths)
    about = About(
        width=size[0],
        height=size[1],
        camera=camera_of(size, numbers[:4], numbers[4:]),
        names=tuple(name for name in TRUTH_NAMES if name in names),
        frame_rate=rate_of(times),
    )

    def shots() -> Iterator[Shot]:
        events = iter(open_source(path / "events.txt"))
        before, batch = 0, next(events, None)
        for time_us in times:
            while batch is not None and (not len(batch) or int(batch["t"][-1]) < time_us):
                before += len(batch)
                batch = next(events, None)
            index = before + (0 if batch is None else int(np.searchsorted(batch["t"], time_us)))
            planes: dict[str, npt.NDArray[Any]] = {}
            if time_us in images:
                planes["image"] = read_png(path / images[time_us])
            if time_us in depths:
                planes["depth"] = read_depth(path / depths[time_us])
            yield Shot(time_us, time_us, time_us, index, planes)

    return Recording(
        about,
        lambda: iter(open_source(path / "events.txt")),
        shots=shots,
        tracks=lambda: iter([read_track(there["poses"], "camera")] if "poses" in there else []),
        imu=lambda: iter([read_imu(there["imu"])] if "imu" in there else []),
    )


def _size(path: Path, images: dict[int, str], depths: dict[int, str]) -> tuple[int, int]:
    """Return width and height: of the first picture or, without any, such that all events are within."""
    for files, read in ((images, read_png), (depths, read_depth)):
        for name in files.values():
            height, width = read(path / name).shape[:2]
            return width, height
    width = height = 1
    for batch in open_source(path / "events.txt"):
        if len(batch):
            width, height = max(width, int(batch["x"].max()) + 1), max(height, int(batch["y"].max()) + 1)
    return width, height


def open_layout(path: Path, about: About) -> EcdLayout:
    """Open a writer of the layout."""
    return EcdLayout(path, about)
