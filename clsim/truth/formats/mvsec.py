"""MVSEC's layout: a folder with ``NAME_data.hdf5``, ``NAME_gt.hdf5`` and ``NAME_gt_flow_dist.npz``.

=============================  ======================================================================================
data: davis/SIDE/events          ``[n, 4]`` x, y, t [s], p ±1
data: davis/SIDE/image_raw       uint8 ``[n, H, W]``, with ``image_raw_ts`` [s] and ``image_raw_event_inds``
data: davis/SIDE/imu             ``[n, 6]`` angular velocity [rad/s], then specific force [m/s²], with ``imu_ts`` [s]
gt: davis/SIDE/depth_image_raw   float32 ``[n, H, W]`` [m] along the optical axis, NaN where nothing is, with ``…_ts``;
                                 ``depth_image_rect`` is the same
gt: davis/SIDE/pose              ``[n, 4, 4]`` camera to world, with ``pose_ts`` [s]
gt: davis/SIDE/flow_dist         ``[n, 2, H, W]`` pixels until the next frame, 0 where it is not known; in the npz too
=============================  ======================================================================================

Times are seconds. Source: Zhu et al., The Multivehicle Stereo Event Camera Dataset, RA-L 2018.
"""

from __future__ import annotations

import bisect
import contextlib
import json
import os
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.events import EventBatch, empty_batch
from clsim.events.formats.filesink import naming_failures, unwritable
from clsim.events.formats.filesource import CHUNK_EVENTS
from clsim.events.formats.tables.hdf5_growing import GrowingHdf5, compressed
from clsim.truth.names import TRUTH_NAMES
from clsim.truth.record import About, ImuChunk, Layout, Shot, TrackChunk
from clsim.truth.recording import Recording
from clsim.truth.writing.images import Pictures, with_images
from clsim.truth.writing.intrinsics import camera_of, yaml_numbers
from clsim.truth.writing.lines import MAX_BYTES, held, microseconds, rate_of
from clsim.truth.writing.poses import matrices
from clsim.truth.writing.poses import rows as pose_rows

_STACKS = {"image": "image_raw", "depth": "depth_image_raw"}


class MvsecLayout(Layout):
    """Writes the folder; the npz of flow is there once the run has ended."""

    def __init__(self, path: Path, about: About) -> None:
        """Create the folder; raises InputError when it cannot be."""
        self._path, self._group = path, f"davis/{about.side}"
        self._name = path.name.removesuffix(".mvsec") or "run"
        self._pictures = Pictures()
        try:
            path.mkdir(exist_ok=True)
        except OSError as error:
            raise unwritable(path, error) from None
        size, names, group = (about.height, about.width), with_images(about.names), self._group

        def data(file: Any) -> None:
            file.attrs["camera"] = json.dumps(dict(about.camera))
            _column(file, f"{group}/events", (4,), "f8", 1 << 14)
            if "image" in names:
                compressed(file, f"{group}/image_raw", size, "u1")
                _column(file, f"{group}/image_raw_ts", (), "f8")
                _column(file, f"{group}/image_raw_event_inds", (), "i8")
            if "imu" in names:
                _column(file, f"{group}/imu", (6,), "f8")
                _column(file, f"{group}/imu_ts", (), "f8")

        def truth(file: Any) -> None:
            file.create_group(group).attrs["pose"] = "camera to world; +x right, +y down, +z ahead"
            if "poses" in names:
                _column(file, f"{group}/pose", (4, 4), "f8")
                _column(file, f"{group}/pose_ts", (), "f8")
            if "depth" in names:
                compressed(file, f"{group}/depth_image_raw", size, "f4")
                _column(file, f"{group}/depth_image_raw_ts", (), "f8")
                file[f"{group}/depth_image_rect"] = file[f"{group}/depth_image_raw"]
                file[f"{group}/depth_image_rect_ts"] = file[f"{group}/depth_image_raw_ts"]
            if "flow" in names:
                compressed(file, f"{group}/flow_dist", (2, *size), "f4")
                _column(file, f"{group}/flow_dist_ts", (), "f8")

        self._data = GrowingHdf5(path / f"{self._name}_data.hdf5", data)
        self._truth = GrowingHdf5(path / f"{self._name}_gt.hdf5", truth)
        self._flows = "flow" in names
        self._closed = False

    def events(self, batch: EventBatch, end_us: int) -> None:
        """Append events."""
        if not len(batch):
            return
        rows = np.stack([batch["x"], batch["y"], batch["t"] * 1e-6, np.where(batch["on"], 1, -1)], axis=1)
        with naming_failures(self._path):
            self._data.append({f"{self._group}/events": rows.astype(np.float64)})

    def shot(self, shot: Shot) -> None:
        """Append a frame."""
        group, time_s = self._group, np.array([shot.time_us * 1e-6])
        with naming_failures(self._path):
            picture = self._pictures.of(shot.planes)
            if picture is not None:
                self._data.append(
                    {
                        f"{group}/image_raw": picture[None],
                        f"{group}/image_raw_ts": time_s,
                        f"{group}/image_raw_event_inds": np.array([shot.event_index]),
                    }
                )
            rows: dict[str, npt.NDArray[Any]] = {}
            if "depth" in shot.planes:
                depth = shot.planes["depth"]
                rows[f"{group}/depth_image_raw"] = np.where(np.isfinite(depth), depth, np.nan)[None]
                rows[f"{group}/depth_image_raw_ts"] = time_s
            if "flow" in shot.planes:
                flow = shot.planes["flow"]
                known = (flow[..., 2] > 0) & np.isfinite(shot.planes.get("depth", flow[..., 2]))
                rows[f"{group}/flow_dist"] = np.moveaxis(np.where(known[..., None], flow[..., :2], 0), 2, 0)[None]
                rows[f"{group}/flow_dist_ts"] = time_s
            if rows:
                self._truth.append(rows)

    def track(self, chunk: TrackChunk) -> None:
        """Append the camera's poses."""
        if chunk.name == "camera":
            with naming_failures(self._path):
                self._truth.append(
                    {f"{self._group}/pose": matrices(chunk.poses), f"{self._group}/pose_ts": chunk.times_us * 1e-6}
                )

    def imu(self, chunk: ImuChunk) -> None:
        """Append inertial samples."""
        rows = np.concatenate([chunk.angular_velocity, chunk.acceleration], axis=1)
        with naming_failures(self._path):
            self._data.append({f"{self._group}/imu": rows, f"{self._group}/imu_ts": chunk.times_us * 1e-6})

    def close(self) -> None:
        """Complete the files."""
        if self._closed:
            return
        self._closed = True
        with naming_failures(self._path):
            if self._flows:
                self._write_flow()
            self._truth.close()
            self._data.close()

    def _write_flow(self) -> None:
        """Write the npz of flow, one frame in memory at a time."""
        flows, times = (self._truth.file[f"{self._group}/{name}"] for name in ("flow_dist", "flow_dist_ts"))
        target = self._path / f"{self._name}_gt_flow_dist.npz"
        part = target.with_name(f".{target.name}.part")
        shape = (len(flows), *flows.shape[2:])
        with zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            with archive.open("timestamps.npy", "w") as file:
                np.lib.format.write_array(file, times[:])
            for axis, name in enumerate(("x_flow_dist", "y_flow_dist")):
                with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                    header = {"descr": "<f4", "fortran_order": False, "shape": shape}
                    np.lib.format.write_array_header_1_0(file, header)
                    for k in range(len(flows)):
                        file.write(np.ascontiguousarray(flows[k, axis], "<f4").tobytes())
        os.replace(part, target)


def is_recording(path: Path) -> bool:
    """Tell whether a folder is of this layout."""
    return len(list(path.glob("*_data.hdf5"))) == 1


def read_recording(path: Path) -> Recording:
    """Open a folder of this layout, the left camera; may raise anything where it is damaged.

    MVSEC's own are read too: their flow lies in the npz alone, and their camera in Kalibr's ``camchain*.yaml``, if that
    is there.
    """
    (data_file,) = path.glob("*_data.hdf5")
    truth_file = data_file.with_name(data_file.name.replace("_data.hdf5", "_gt.hdf5"))
    flow_file = data_file.with_name(data_file.name.replace("_data.hdf5", "_gt_flow_dist.npz"))
    group = "davis/left"
    with h5py.File(data_file, "r") as data, _truth(truth_file) as truth:
        left, known = data[group], truth.get(group, {})
        names = {name for name, key in (("image", "image_raw"), ("imu", "imu")) if key in left}
        names |= {name for name, key in (("depth", "depth_image_raw"), ("poses", "pose")) if key in known}
        times = {name: microseconds(held(left[f"{_STACKS[name]}_ts"])) for name in names & {"image"}}
        times |= {name: microseconds(held(known[f"{_STACKS[name]}_ts"])) for name in names & {"depth"}}
        camera = _camera(path, data, next((stack.shape[1:] for stack in _stacks(left, known)), None))
        if "flow_dist" in known:  # as clsim writes it, also where a run was killed before there was an npz
            times["flow"] = microseconds(held(known["flow_dist_ts"]))
        elif flow_file.is_file():
            times["flow"] = microseconds(_read_flow_times(flow_file))
    names |= times.keys()
    size = camera["height"], camera["width"]
    all_times = sorted({time_us for own in times.values() for time_us in own.tolist()})
    about = About(
        width=camera["width"],
        height=camera["height"],
        camera=camera,
        names=tuple(name for name in TRUTH_NAMES if name in names),
        frame_rate=rate_of(all_times),
    )

    def events() -> Iterator[EventBatch]:
        with h5py.File(data_file, "r") as data:
            rows = data[f"{group}/events"]
            for start in range(0, len(rows), CHUNK_EVENTS):
                part = rows[start : start + CHUNK_EVENTS]
                batch = empty_batch(len(part))
                batch["x"], batch["y"], batch["on"] = part[:, 0], part[:, 1], part[:, 3] > 0
                batch["t"] = microseconds(part[:, 2])
                yield batch

    def shots() -> Iterator[Shot]:
        numbers = {name: {time_us: k for k, time_us in enumerate(own.tolist())} for name, own in times.items()}
        with h5py.File(data_file, "r") as data, _truth(truth_file) as truth:
            rows, stored_flow = data[f"{group}/events"], truth.get(f"{group}/flow_dist")
            flows = _read_flow(flow_file, size) if stored_flow is None else _rows(stored_flow)
            for time_us in all_times:
                planes = {}
                for name, file in (("image", data), ("depth", truth)):
                    if time_us in numbers.get(name, {}):
                        stored = held(file[f"{group}/{_STACKS[name]}"], numbers[name][time_us])
                        planes[name] = stored if name == "image" else _depth(stored)
                after_us = time_us
                if time_us in numbers.get("flow", {}):
                    flow = next(flows, None)
                    if flow is None:
                        raise ValueError(f"there are {len(times['flow'])} times of flow, but fewer frames of it")
                    planes["flow"], after_us = _flow(flow), _following(times["flow"], numbers["flow"][time_us])
                yield Shot(time_us, time_us, after_us, _index_at(rows, time_us), planes)

    def tracks() -> Iterator[TrackChunk]:
        if "poses" in names:
            with _truth(truth_file) as truth:
                poses, times_s = (held(truth[f"{group}/{key}"]) for key in ("pose", "pose_ts"))
            unknown = np.full((len(poses), 6), np.nan)
            yield TrackChunk("camera", microseconds(times_s), pose_rows(poses), unknown)

    def imu() -> Iterator[ImuChunk]:
        with h5py.File(data_file, "r") as data:
            if "imu" in names:
                samples, times_s = (held(data[f"{group}/{key}"]) for key in ("imu", "imu_ts"))
                yield ImuChunk(microseconds(times_s), samples[:, 3:], samples[:, :3])

    return Recording(about, events, shots=shots, tracks=tracks, imu=imu)


def _truth(path: Path) -> Any:
    """Open the file of truth; where there is none, nothing is known."""
    return h5py.File(path, "r") if path.is_file() else contextlib.nullcontext({})


def _stacks(left: Any, known: Any) -> Iterator[Any]:
    for group, name in ((left, "image"), (known, "depth")):
        if _STACKS[name] in group:
            yield group[_STACKS[name]]


def _camera(path: Path, data: Any, size: tuple[int, int] | None) -> dict[str, Any]:
    """Return the left camera: as clsim wrote it, by Kalibr's calibration, or at least how large it is."""
    if "camera" in data.attrs:
        told: dict[str, Any] = json.loads(data.attrs["camera"])
        return told
    for file in sorted(path.glob("camchain*.yaml")):
        text = file.read_text("utf-8-sig").partition("cam0:")[2].partition("cam1:")[0]
        matrix, coefficients = (yaml_numbers(text, key) for key in ("intrinsics", "distortion_coeffs"))
        shape = yaml_numbers(text, "resolution")
        if len(matrix) != 4 or len(shape) != 2:
            raise ValueError(f"{file} has no intrinsics or no resolution of cam0")
        return camera_of((int(shape[0]), int(shape[1])), matrix, coefficients, fisheye="equidistant" in text)
    if size is None:
        raise ValueError(f"{path} has no picture, no depth and no camchain*.yaml that tell the sensor's size")
    return {"width": size[1], "height": size[0]}


def _index_at(rows: Any, time_us: int) -> int:
    """Return the index of the first event at or after a time, of rows sorted by time."""
    return bisect.bisect_left(range(len(rows)), time_us, key=lambda k: int(microseconds([rows[k, 2]])[0]))


def _following(times_us: npt.NDArray[np.int64], number: int) -> int:
    """Return the next of some times; after the last, as long after it as it is after the one before."""
    if number + 1 < len(times_us):
        return int(times_us[number + 1])
    return int(2 * times_us[-1] - times_us[-2]) if len(times_us) > 1 else int(times_us[-1])


def _rows(stack: Any) -> Iterator[npt.NDArray[Any]]:
    for k in range(len(stack)):
        yield held(stack, k)


def _read_flow(path: Path, size: tuple[int, int]) -> Iterator[npt.NDArray[np.float64]]:
    """Yield flow ``[2, H, W]``, one frame in memory at a time, from an npz of x_flow_dist and y_flow_dist."""
    with zipfile.ZipFile(path) as archive, contextlib.ExitStack() as opened:
        columns = []
        for name in ("x_flow_dist", "y_flow_dist"):
            file = opened.enter_context(archive.open(f"{name}.npy"))
            shape, kind = _header(path, file)
            if shape[1:] != size:
                raise ValueError(f"{path} has {name} of {shape}, expected frames of {size}")
            columns.append((file, kind))
        for _ in range(shape[0]):
            yield np.stack(
                [np.frombuffer(f.read(size[0] * size[1] * kind.itemsize), kind).reshape(size) for f, kind in columns]
            )


def _read_flow_times(path: Path) -> npt.NDArray[np.float64]:
    """Return the times [s] of an npz of flow."""
    with zipfile.ZipFile(path) as archive, archive.open("timestamps.npy") as file:
        shape, kind = _header(path, file)
        found: npt.NDArray[np.float64] = np.frombuffer(file.read(MAX_BYTES), kind)
    if found.shape != shape:
        raise ValueError(f"{path} has {len(found)} timestamps, but tells of {shape}")
    return found


def _header(path: Path, file: Any) -> tuple[tuple[int, ...], Any]:
    """Return the shape and type that the head of an npy tells; raises ValueError where they are no rows of floats."""
    modern = np.lib.format.read_magic(file) != (1, 0)
    read = np.lib.format.read_array_header_2_0 if modern else np.lib.format.read_array_header_1_0
    shape, by_column, kind = read(file)
    if (by_column and len(shape) > 1) or kind.kind != "f":
        raise ValueError(f"{path} has {shape} of {kind}, expected floats in the order of rows")
    return shape, kind


def _depth(stored: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
    return np.where(np.isnan(stored), np.inf, stored).astype(np.float32)


def _flow(stored: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
    known = np.any(stored != 0, axis=0)
    return np.stack([*stored, known, np.zeros_like(known)], axis=-1).astype(np.float32)


def _column(file: Any, name: str, width: tuple[int, ...], kind: str, rows: int = 1 << 10) -> None:
    file.create_dataset(name, (0, *width), kind, maxshape=(None, *width), chunks=(rows, *width))


def open_layout(path: Path, about: About) -> MvsecLayout:
    """Open a writer of the layout."""
    if not path.name.lower().endswith(".mvsec"):
        raise InputError(f"{path}: expected a name that ends in .mvsec")
    return MvsecLayout(path, about)
