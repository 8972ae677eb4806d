"""DSEC's layout: a folder of events in HDF5, images, disparity and flow in PNG, and text files of times.

==========================================  ======================================================================
events/SIDE/events.h5                       as DSEC has it
events/SIDE/rectify_map.h5                  the identity: what is recorded is its own rectified view
images/SIDE/rectified/000000.png            8-bit sRGB grey, one exposure for the run; times in images/timestamps.txt
disparity/event/000000.png                  256 · disparity [px], 0 where there is none; disparity/timestamps.txt
flow/forward/000000.png, flow/backward/…    32768 + 128 · flow, valid; from and to in flow/forward_timestamps.txt;
                                            none that leads to before or beyond the recording
calibration/cam_to_cam.yaml                 intrinsics, extrinsics and the matrix from disparity to depth
==========================================  ======================================================================

Beyond DSEC, in the same manner: ``flow/forward_covisible/000000.png``, ``ids/object/000000.png``, ``ids/objects.txt``,
``poses/NAME.txt`` (TUM), ``imu.txt`` (ECD). Disparity is that of a second camera to the right by the baseline that the
calibration tells.

DSEC's own sequences are read too. Their depth and flow are those of the rectified view, while their events are not
rectified: where ``rectify_map.h5`` is not the identity, pixels of one are not those of the other. Their images, of
another camera and size, are left out.

Source: https://dsec.ifi.uzh.ch/data-format/
"""

from __future__ import annotations

import re
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
from clsim.truth.writing.intrinsics import camera_of, opencv_numbers, yaml_numbers
from clsim.truth.writing.lines import Lines, imu_lines, rate_of, read_imu, read_track, tum_lines
from clsim.truth.writing.png import read_png, write_png

FLOW_HEAD = "# from_timestamp_us, to_timestamp_us\n"
_POSE_HEAD = "# time_s x y z qx qy qz qw: to the world, m; the camera's +x is right, +y down, +z ahead\n"
_IMU_HEAD = "# time_s ax ay az gx gy gz: m/s^2 and rad/s along the camera's axes (+x right, +y down, +z ahead)\n"
FLOW_REACH_PX = 255.9


class DsecLayout(Layout):
    """Writes the folder; several cameras of a rig may write into one, each to a side of its own."""

    def __init__(self, path: Path, about: About) -> None:
        """Create the folder; raises InputError when it cannot be."""
        self._path, self._about, self._side = path, about, about.side
        self._count = 0
        self._end_us = 0
        # Of the newest frame's flow, its file, where it leads, and its line: whether that is beyond all is known later.
        self._newest: tuple[str, int, str] | None = None
        self._pictures = Pictures()
        # Disparity, flow and ids are those of the left view alone, as DSEC has them.
        self._leads = about.side == "left"
        self._texts: dict[str, Lines] = {}
        try:
            self._folder("events", self._side)
            self._sink = Hdf5Sink(
                self._folder("events", self._side) / "events.h5", about.width, about.height, FlushPolicy()
            )
            self._prepare()
        except OSError as error:
            raise unwritable(path, error) from None

    def events(self, batch: EventBatch, end_us: int) -> None:
        """Append events."""
        self._sink.write(batch, end_us)
        self._end_us = max(self._end_us, end_us)

    def shot(self, shot: Shot) -> None:
        """Write a frame's images, then the lines that tell of them."""
        name, planes = f"{self._count:06d}.png", shot.planes
        self._end_us = max(self._end_us, shot.time_us)
        with naming_failures(self._path):
            picture = self._pictures.of(planes)
            if picture is not None:
                write_png(self._path / "images" / self._side / "rectified" / name, picture)
                self._texts["images/timestamps.txt"].add([f"{shot.time_us}"])
            if self._leads:
                self._write_truth(name, shot)
        self._count += 1

    def track(self, chunk: TrackChunk) -> None:
        """Append poses."""
        if chunk.name in self._texts:
            self._texts[chunk.name].add(tum_lines(chunk))

    def imu(self, chunk: ImuChunk) -> None:
        """Append inertial samples."""
        if "imu.txt" in self._texts:
            self._texts["imu.txt"].add(imu_lines(chunk))

    def close(self) -> None:
        """Complete the files."""
        self._sink.close()
        if self._newest is not None:
            name, to_us, line = self._newest
            if to_us <= self._end_us:
                self._texts["flow/forward_timestamps.txt"].add([line])
            else:
                for folder in ("forward", "forward_covisible"):
                    (self._path / "flow" / folder / name).unlink(missing_ok=True)
        for text in self._texts.values():
            text.close()

    def _write_truth(self, name: str, shot: Shot) -> None:
        planes = shot.planes
        if "depth" in planes:
            focal = abs(self._about.camera["intrinsics_px"]["fx"])
            disparity = disparity_image(planes["depth"], focal * self._about.baseline_m)
            write_png(self._path / "disparity" / "event" / name, disparity)
            self._texts["disparity/timestamps.txt"].add([f"{shot.time_us}"])
        if "flow" in planes:
            if self._newest is not None:
                self._texts["flow/forward_timestamps.txt"].add([self._newest[2]])
            self._newest = name, shot.after_us, f"{shot.time_us}, {shot.after_us}"
            self._write_flow(name, "forward", planes["flow"])
        if "backward-flow" in planes and shot.before_us >= 0:
            self._write_flow(name, "backward", planes["backward-flow"])
            self._texts["flow/backward_timestamps.txt"].add([f"{shot.time_us}, {shot.before_us}"])
        for key in ("object", "material"):
            if key in planes:
                write_png(self._path / "ids" / key / name, np.minimum(planes[key], 65535).astype(np.uint16))

    def _write_flow(self, name: str, way: str, flow: npt.NDArray[Any]) -> None:
        write_png(self._path / "flow" / way / name, flow_image(flow))
        write_png(self._path / "flow" / f"{way}_covisible" / name, (flow[..., 3] > 0).astype(np.uint8))

    def _prepare(self) -> None:
        about, names = self._about, with_images(self._about.names)
        with h5py.File(self._folder("events", self._side) / "rectify_map.h5", "w") as file:
            x, y = np.meshgrid(np.arange(about.width), np.arange(about.height))
            file["rectify_map"] = np.stack([x, y], axis=-1).astype(np.float32)
        if "image" in names:
            self._folder("images", self._side, "rectified")
            self._text("images/timestamps.txt")
        if not self._leads:
            return
        (self._folder("calibration") / "cam_to_cam.yaml").write_text(calibration(about), encoding="utf-8")
        if "depth" in names:
            self._folder("disparity", "event")
            self._text("disparity/timestamps.txt")
        for key, way in (("flow", "forward"), ("backward-flow", "backward")):
            if key in names:
                self._folder("flow", way)
                self._folder("flow", f"{way}_covisible")
                self._text(f"flow/{way}_timestamps.txt", FLOW_HEAD)
        if "ids" in names:
            for kind, each in (("object", about.objects), ("material", about.materials)):
                self._folder("ids", kind)
                (self._path / "ids" / f"{kind}s.txt").write_text(
                    "".join(f"{name}\n" for name in each), encoding="utf-8"
                )
        if "poses" in names:
            self._folder("poses")
            for name, file_name in pose_files(about).items():
                self._texts[name] = Lines(self._path / "poses" / file_name, f"# of: {name}\n{_POSE_HEAD}")
        if "imu" in names:
            self._text("imu.txt", _IMU_HEAD)

    def _folder(self, *parts: str) -> Path:
        path = self._path.joinpath(*parts)
        path.mkdir(parents=True, exist_ok=True)
        return path

    def _text(self, name: str, head: str = "") -> None:
        self._texts[name] = Lines(self._path / name, head)


def pose_files(about: About) -> dict[str, str]:
    """Return the names of the files of poses, by what they are of: characters that file systems mind are left out."""
    safe = {name: re.sub(r"[^A-Za-z0-9_.-]+", "_", name) for name in about.moving}
    numbered = {name: f"{number + 1:04d}_{safe[name][:64]}.txt" for number, name in enumerate(about.moving)}
    return {"camera": "camera.txt"} | numbered


def disparity_image(depth_m: npt.NDArray[np.float32], focal_baseline: float) -> npt.NDArray[np.uint16]:
    """Return 256 · focal length · baseline / depth; 0 where nothing is, or it is too near for 16 bits."""
    with np.errstate(divide="ignore"):
        scaled = np.rint(256.0 * focal_baseline / depth_m.astype(np.float64))
    image: npt.NDArray[np.uint16] = np.where((scaled >= 1) & (scaled <= 65535), scaled, 0).astype(np.uint16)
    return image


def flow_image(flow: npt.NDArray[np.float32]) -> npt.NDArray[np.uint16]:
    """Return 32768 + 128 · flow in red and green, valid in blue; what 16 bits cannot hold is not valid."""
    valid = (flow[..., 2] > 0) & (np.abs(flow[..., :2]) <= FLOW_REACH_PX).all(axis=-1)
    scaled = np.where(valid[..., None], np.rint(32768 + 128.0 * flow[..., :2].astype(np.float64)), 0)
    image: npt.NDArray[np.uint16] = np.concatenate([scaled, valid[..., None]], axis=-1).astype(np.uint16)
    return image


def calibration(about: About) -> str:
    """Return cam_to_cam.yaml; pixels as OpenCV counts them, the first one's centre at 0, 0.

    Raises:
        InputError: the camera has no intrinsics.
    """
    camera = about.camera
    (fx, fy, cx, cy), told = opencv_numbers(camera)
    fisheye, coefficients = camera["model"] == "fisheye", ", ".join(map(repr, told))
    lines = ["intrinsics:"]
    for name in ("cam0", "camRect0"):
        lines += [
            f"  {name}:",
            "    camera_model: pinhole",
            f"    camera_matrix: [{fx!r}, {fy!r}, {cx!r}, {cy!r}]",
            f"    distortion_model: {'equidistant' if fisheye else 'radtan'}",
            f"    distortion_coeffs: [{coefficients}]",
            f"    resolution: [{about.width}, {about.height}]",
        ]
    lines.append("extrinsics:")
    identity = ", ".join(str([float(i == j) for j in range(3)]) for i in range(3))
    lines.append(f"  R_rect0: [{identity}]")
    for name, matrix in about.extrinsics.items():
        rows = ", ".join(str([float(v) for v in row]) for row in matrix)
        lines.append(f"  T_{name}_{about.camera_name}: [{rows}]")
    lines += [
        "disparity_to_depth:",
        "  cams_03:",
        f"    - [1.0, 0.0, 0.0, {-cx!r}]",
        f"    - [0.0, 1.0, 0.0, {-cy!r}]",
        f"    - [0.0, 0.0, 0.0, {fx!r}]",
        f"    - [0.0, 0.0, {1.0 / about.baseline_m!r}, 0.0]",
    ]
    return "\n".join(lines) + "\n"


def is_recording(path: Path) -> bool:
    """Tell whether a folder is of this layout."""
    return (path / "events" / "left" / "events.h5").is_file()


def read_recording(path: Path) -> Recording:
    """Open a folder of this layout; may raise anything where it is damaged."""
    camera, baseline_m = _read_calibration(path / "calibration" / "cam_to_cam.yaml")
    width, height = camera["width"], camera["height"]
    times = _Times(path, (height, width))
    names = {
        "image": bool(times.images),
        "depth": bool(times.disparity),
        "flow": bool(times.forward),
        "backward-flow": bool(times.backward),
        "ids": (path / "ids" / "object").is_dir(),
        "poses": (path / "poses" / "camera.txt").is_file(),
        "imu": (path / "imu.txt").is_file(),
    }
    tracks = {"camera": path / "poses" / "camera.txt"}
    tracks |= {_track_name(each): each for each in sorted((path / "poses").glob("[0-9]*.txt"))}
    about = About(
        width=width,
        height=height,
        camera=camera,
        names=tuple(name for name in TRUTH_NAMES if names.get(name)),
        frame_rate=rate_of(times.all()),
        objects=_read_names(path / "ids" / "objects.txt"),
        materials=_read_names(path / "ids" / "materials.txt"),
        moving=tuple(name for name in tracks if name != "camera"),
        baseline_m=baseline_m,
    )
    focal = abs(camera["intrinsics_px"]["fx"])

    def shots() -> Iterator[Shot]:
        with h5py.File(path / "events" / "left" / "events.h5", "r") as file:
            for time_us in times.all():
                yield _read_shot(path, times, time_us, focal * baseline_m, index_at(file, time_us))

    return Recording(
        about,
        lambda: iter(open_source(path / "events" / "left" / "events.h5")),
        shots=shots,
        tracks=lambda: iter([read_track(each, name) for name, each in tracks.items() if names["poses"]]),
        imu=lambda: iter([read_imu(path / "imu.txt")] if names["imu"] else []),
    )


class _Times:
    """What there is for which time: its file, and the time that it leads to."""

    def __init__(self, path: Path, size: tuple[int, int]) -> None:
        self.images = _files(path / "images/timestamps.txt", path / "images/left/rectified", 1)
        if self.images and read_png(next(iter(self.images.values()))[0]).shape != size:
            self.images = {}
        self.disparity = _files(path / "disparity/timestamps.txt", path / "disparity/event", 1)
        self.forward = _files(path / "flow/forward_timestamps.txt", path / "flow/forward", 2)
        self.backward = _files(path / "flow/backward_timestamps.txt", path / "flow/backward", 2)

    def all(self) -> list[int]:
        """Return all times, in order."""
        return sorted({*self.images, *self.disparity, *self.forward, *self.backward})


def _files(text: Path, folder: Path, columns: int) -> dict[int, tuple[Path, int]]:
    """Return a line's file and its last time, by its first time.

    Files belong to lines in the order of their names: DSEC leaves numbers out.
    """
    if not text.is_file():
        return {}
    lines = [line for line in text.read_text("utf-8-sig").splitlines() if line.strip() and not line.startswith("#")]
    rows = [[int(word) for word in line.split(",")] for line in lines]
    if any(len(row) != columns for row in rows):
        raise ValueError(f"{text} has a line of other than {columns} times")
    files = sorted(folder.glob("*.png"))
    if len(files) < len(rows):
        raise ValueError(f"{folder} has {len(files)} pictures, expected {len(rows)}, as {text.name} has lines")
    return {row[0]: (file, row[-1]) for row, file in zip(rows, files, strict=False)}


def _read_shot(path: Path, times: _Times, time_us: int, focal_baseline: float, event_index: int) -> Shot:
    planes: dict[str, npt.NDArray[Any]] = {}
    before_us = after_us = time_us
    if time_us in times.images:
        planes["image"] = read_png(times.images[time_us][0])
    if time_us in times.disparity:
        file, _ = times.disparity[time_us]
        disparity = read_png(file) / 256.0
        with np.errstate(divide="ignore"):
            planes["depth"] = (focal_baseline / disparity).astype(np.float32)
        for key in ("object", "material"):
            if (path / "ids" / key / file.name).is_file():
                planes[key] = read_png(path / "ids" / key / file.name).astype(np.float32)
    if time_us in times.forward:
        file, after_us = times.forward[time_us]
        planes["flow"] = _read_flow(file)
    if time_us in times.backward:
        file, before_us = times.backward[time_us]
        planes["backward-flow"] = _read_flow(file)
    return Shot(time_us, before_us, after_us, event_index, planes)


def _read_flow(file: Path) -> npt.NDArray[np.float32]:
    coded = read_png(file).astype(np.float32)
    seen = file.parent.with_name(f"{file.parent.name}_covisible") / file.name
    covisible = read_png(seen).astype(np.float32) if seen.is_file() else np.zeros(coded.shape[:2], np.float32)
    valid = coded[..., 2:] > 0
    flow = np.where(valid, (coded[..., :2] - 32768.0) / 128.0, 0.0)
    return np.concatenate([flow, valid, covisible[..., None]], axis=-1).astype(np.float32)


def _read_calibration(path: Path) -> tuple[dict[str, Any], float]:
    """Return the camera and the baseline [m] that a cam_to_cam.yaml tells."""
    text = path.read_text("utf-8-sig")
    rectified = text.partition("camRect0:")[2] or text

    # The rectified left camera's own lines, up to the next one's name.
    mine = re.split(r"\n\s*(?:cam\d|camRect\d|extrinsics):", rectified)[0]

    def told(key: str, count: int, text: str = mine) -> list[float]:
        found = yaml_numbers(text, key)
        if len(found) < count:
            raise ValueError(f"{path} has no {key}")
        return found[:count]

    width, height = map(int, told("resolution", 2))
    fisheye = re.search(r"distortion_model:\s*equidistant", mine) is not None
    coefficients = yaml_numbers(mine, "distortion_coeffs")
    camera = camera_of((width, height), told("camera_matrix", 4), coefficients, fisheye=fisheye)
    to_depth = told("cams_03", 16, text)
    return camera, 1.0 / to_depth[14]


def _read_names(path: Path) -> tuple[str, ...]:
    return tuple(path.read_text("utf-8-sig").splitlines()) if path.is_file() else ()


def _track_name(path: Path) -> str:
    with path.open(encoding="utf-8") as file:
        head = file.readline()
    return head.partition("of: ")[2].strip() or path.stem


def open_layout(path: Path, about: About) -> DsecLayout:
    """Open a writer of the layout."""
    return DsecLayout(path, about)
