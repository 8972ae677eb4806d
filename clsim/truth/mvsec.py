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
from clsim.events.filesink import naming_failures, unwritable
from clsim.events.filesource import CHUNK_EVENTS
from clsim.events.hdf5_growing import GrowingHdf5
from clsim.truth.images import Pictures, with_images
from clsim.truth.lines import microseconds, rate_of
from clsim.truth.names import TRUTH_NAMES
from clsim.truth.poses import matrices
from clsim.truth.poses import rows as pose_rows
from clsim.truth.record import About, ImuChunk, Layout, Shot, TrackChunk
from clsim.truth.recording import Recording

_GZIP: dict[str, Any] = {"compression": "gzip", "compression_opts": 1, "shuffle": True}


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
                _images(file, f"{group}/image_raw", size, "u1")
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
                _images(file, f"{group}/depth_image_raw", size, "f4")
                _column(file, f"{group}/depth_image_raw_ts", (), "f8")
                file[f"{group}/depth_image_rect"] = file[f"{group}/depth_image_raw"]
                file[f"{group}/depth_image_rect_ts"] = file[f"{group}/depth_image_raw_ts"]
            if "flow" in names:
                _images(file, f"{group}/flow_dist", (2, *size), "f4")
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
    """Open a folder of this layout, the left camera; raises OSError, KeyError or ValueError where it is damaged."""
    (data_file,) = path.glob("*_data.hdf5")
    truth_file = data_file.with_name(data_file.name.replace("_data.hdf5", "_gt.hdf5"))
    keys = {"image": "image_raw", "imu": "imu"}
    truth_keys = {"depth": "depth_image_raw", "flow": "flow_dist", "poses": "pose"}
    group = "davis/left"
    with h5py.File(data_file, "r") as data, h5py.File(truth_file, "r") as truth:
        names = {name for name, key in keys.items() if key in data[group]}
        names |= {name for name, key in truth_keys.items() if key in truth.get(group, {})}
        times = sorted(
            {
                *(microseconds(data[f"{group}/image_raw_ts"][:]).tolist() if "image" in names else ()),
                *(microseconds(truth[f"{group}/depth_image_raw_ts"][:]).tolist() if "depth" in names else ()),
                *(microseconds(truth[f"{group}/flow_dist_ts"][:]).tolist() if "flow" in names else ()),
            }
        )
        camera = json.loads(data.attrs["camera"])
    about = About(
        width=camera["width"],
        height=camera["height"],
        camera=camera,
        names=tuple(name for name in TRUTH_NAMES if name in names),
        frame_rate=rate_of(times),
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
        with h5py.File(data_file, "r") as data, h5py.File(truth_file, "r") as truth:
            stacks = {
                name: (file[f"{group}/{key}"], microseconds(file[f"{group}/{key}_ts"][:]).tolist())
                for name, key, file in (
                    ("image", "image_raw", data),
                    ("depth", "depth_image_raw", truth),
                    ("flow", "flow_dist", truth),
                )
                if name in names
            }
            for k, time_us in enumerate(times):
                after_us = times[k + 1] if k + 1 < len(times) else 2 * time_us - times[k - 1]
                index = int(data[f"{group}/image_raw_event_inds"][k]) if "image" in names else 0
                planes = {}
                for name, (stack, own) in stacks.items():
                    if time_us in own:
                        planes[name] = _plane(name, stack[own.index(time_us)])
                yield Shot(time_us, time_us, after_us, index, planes)

    def tracks() -> Iterator[TrackChunk]:
        with h5py.File(truth_file, "r") as truth:
            if "poses" in names:
                poses, times_s = truth[f"{group}/pose"][:], truth[f"{group}/pose_ts"][:]
                unknown = np.full((len(poses), 6), np.nan)
                yield TrackChunk("camera", microseconds(times_s), pose_rows(poses), unknown)

    def imu() -> Iterator[ImuChunk]:
        with h5py.File(data_file, "r") as data:
            if "imu" in names:
                samples, times_s = data[f"{group}/imu"][:], data[f"{group}/imu_ts"][:]
                yield ImuChunk(microseconds(times_s), samples[:, 3:], samples[:, :3])

    return Recording(about, events, shots=shots, tracks=tracks, imu=imu)


def _plane(name: str, stored: npt.NDArray[Any]) -> npt.NDArray[Any]:
    if name == "depth":
        return np.where(np.isnan(stored), np.inf, stored).astype(np.float32)
    if name == "flow":
        known = np.any(stored != 0, axis=0)
        return np.stack([*stored, known, np.zeros_like(known)], axis=-1).astype(np.float32)
    return stored


def _column(file: Any, name: str, width: tuple[int, ...], kind: str, rows: int = 1 << 10) -> None:
    file.create_dataset(name, (0, *width), kind, maxshape=(None, *width), chunks=(rows, *width))


def _images(file: Any, name: str, shape: tuple[int, ...], kind: str) -> None:
    file.create_dataset(name, (0, *shape), kind, maxshape=(None, *shape), chunks=(1, *shape), **_GZIP)


def open_layout(path: Path, about: About) -> MvsecLayout:
    """Open a writer of the layout."""
    if not path.name.lower().endswith(".mvsec"):
        raise InputError(f"{path}: expected a name that ends in .mvsec")
    return MvsecLayout(path, about)
