"""event_utils' layouts, in one folder: ``memmap/*.npy``, which grow, and ``NAME.h5``, once the run has ended.

======================  ============================================================================================
events/xs, ys           int16 ``[n]``; ``memmap/xy.npy`` is ``[n, 2]``
events/ts               float64 ``[n]`` [s]; ``memmap/t.npy`` is ``[n, 1]``
events/ps               bool ``[n]``, whether ON; ``memmap/p.npy`` is uint8 ``[n, 1]``
images/image000000000   uint8 ``[H, W]``, with ``timestamp`` [s] and ``event_idx``, the last event before it; all are
                        ``memmap/images.npy`` ``[n, H, W, 1]``, ``timestamps.npy`` and ``image_event_indices.npy``
flow/flow000000000      float32 ``[2, H, W]`` [px/s], x and y, 0 where it is not known; all are
                        ``memmap/optic_flow.npy`` with ``optic_flow_timestamps.npy`` and ``optic_flow_stamps.npy``
======================  ============================================================================================

Attributes of the file: ``num_events``, ``num_pos``, ``num_neg``, ``num_imgs``, ``num_flow``, ``t0``, ``tk``,
``duration`` [s] and ``sensor_resolution`` (height, width); ``camera`` is clsim's own. The memmap has them in
``metadata.json``.

Source: Stoffregen et al., Reducing the Sim-to-Real Gap for Event Cameras, ECCV 2020, whose data sets have this layout.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.events import EventBatch, empty_batch
from clsim.events.formats.filesink import PartFile, naming_failures, unwritable
from clsim.events.formats.filesource import CHUNK_EVENTS
from clsim.truth.names import TRUTH_NAMES
from clsim.truth.record import About, Layout, Shot
from clsim.truth.recording import Recording
from clsim.truth.writing.growing_npy import GrowingNpy
from clsim.truth.writing.images import Pictures, with_images
from clsim.truth.writing.lines import held, microseconds, rate_of

_LARGEST_SIDE = 1 << 15  # coordinates have 16 bits and a sign


class EventUtilsLayout(Layout):
    """Writes the folder."""

    def __init__(self, path: Path, about: About) -> None:
        """Create the folder; raises InputError when it cannot be, or for a sensor that is too large."""
        if max(about.width, about.height) > _LARGEST_SIDE:
            raise InputError(f"{path}: {about.width}x{about.height} pixels do not fit 16 bits with a sign")
        self._path, self._about = path, about
        self._h5 = path / f"{path.name.removesuffix('.event_utils') or 'run'}.h5"
        self._pictures = Pictures()
        size, names = (about.height, about.width), with_images(about.names)
        self._facts: dict[str, Any] = {"num_events": 0, "num_pos": 0, "t0": 0.0, "tk": 0.0}
        self._columns: dict[str, GrowingNpy] = {}
        self._closed = False
        wanted: dict[str, tuple[tuple[int, ...], str]] = {"t": ((1,), "<f8"), "xy": ((2,), "<i2"), "p": ((1,), "u1")}
        if "image" in names:
            wanted |= {"images": ((*size, 1), "u1"), "timestamps": ((1,), "<f8")}
            wanted["image_event_indices"] = ((1,), "<i8")
        if "flow" in names:
            wanted |= {"optic_flow": ((2, *size), "<f4"), "optic_flow_timestamps": ((1,), "<f8")}
            wanted["optic_flow_stamps"] = ((1,), "<f8")  # one of event_utils' two readers calls them so
        try:
            (path / "memmap").mkdir(parents=True, exist_ok=True)
            for name, (shape, kind) in wanted.items():
                self._columns[name] = GrowingNpy(path / "memmap" / f"{name}.npy", shape, kind)
        except OSError as error:
            raise unwritable(path, error) from None

    def events(self, batch: EventBatch, end_us: int) -> None:
        """Append events."""
        if not len(batch):
            return
        t = batch["t"] * 1e-6
        with naming_failures(self._path):
            self._columns["t"].append(t[:, None])
            self._columns["xy"].append(np.stack([batch["x"], batch["y"]], axis=1))
            self._columns["p"].append(batch["on"][:, None])
        facts = self._facts
        if facts["num_events"] == 0:
            facts["t0"] = float(t[0])
        facts["tk"] = float(t[-1])
        facts["num_events"] += len(batch)
        facts["num_pos"] += int(np.count_nonzero(batch["on"]))

    def shot(self, shot: Shot) -> None:
        """Append a frame."""
        time_s = np.array([[shot.time_us * 1e-6]])
        columns = self._columns
        with naming_failures(self._path):
            picture = self._pictures.of(shot.planes)
            if picture is not None and "images" in columns:
                columns["images"].append(picture[None, :, :, None])
                columns["image_event_indices"].append(np.array([[max(shot.event_index - 1, 0)]]))
                columns["timestamps"].append(time_s)
            if "flow" in shot.planes and "optic_flow" in columns:
                flow, seconds = shot.planes["flow"].astype(np.float64), (shot.after_us - shot.time_us) * 1e-6
                speed = np.where(flow[..., 2:3] > 0, flow[..., :2], 0.0) / (seconds if seconds > 0 else 1.0)
                columns["optic_flow"].append(np.moveaxis(speed, 2, 0)[None])
                columns["optic_flow_timestamps"].append(time_s)
                columns["optic_flow_stamps"].append(time_s)

    def close(self) -> None:
        """Complete the memmap, and write the HDF5 file."""
        if self._closed:
            return
        self._closed = True
        with naming_failures(self._path):
            for column in self._columns.values():
                column.close()
            facts = self._facts | {
                "num_neg": self._facts["num_events"] - self._facts["num_pos"],
                "num_imgs": self._count("images"),
                "num_flow": self._count("optic_flow"),
                "duration": self._facts["tk"] - self._facts["t0"],
                "sensor_resolution": [self._about.height, self._about.width],
            }
            (self._path / "memmap" / "metadata.json").write_text(json.dumps(facts), "utf-8")
            whole = PartFile(self._h5)
            try:
                with h5py.File(whole.part, "w") as file:
                    file.attrs.update(facts | {"camera": json.dumps(dict(self._about.camera))})
                    self._write_events(file)
                    self._write_frames(file)
                whole.complete()
            finally:
                whole.discard()

    def _count(self, name: str) -> int:
        return self._columns[name].count if name in self._columns else 0

    def _column(self, name: str) -> npt.NDArray[Any]:
        column: npt.NDArray[Any] = np.load(self._path / "memmap" / f"{name}.npy", mmap_mode="r")
        return column

    def _write_events(self, file: Any) -> None:
        count = self._facts["num_events"]
        xs, ys = (file.create_dataset(f"events/{name}", (count,), "<i2") for name in ("xs", "ys"))
        ts = file.create_dataset("events/ts", (count,), "<f8")
        ps = file.create_dataset("events/ps", (count,), "?")
        if not count:
            return
        t, xy, p = (self._column(name) for name in ("t", "xy", "p"))
        for start in range(0, count, CHUNK_EVENTS):
            rows = slice(start, start + CHUNK_EVENTS)
            xs[rows], ys[rows], ts[rows], ps[rows] = xy[rows, 0], xy[rows, 1], t[rows, 0], p[rows, 0] > 0

    def _write_frames(self, file: Any) -> None:
        for group, name, values, times in (
            ("images", "image", "images", "timestamps"),
            ("flow", "flow", "optic_flow", "optic_flow_timestamps"),
        ):
            frames = file.create_group(group) if group == "images" or values in self._columns else None
            if frames is None:
                continue
            count = self._count(values)
            frames.attrs["num_images"] = count
            if not count:
                continue
            stack, stamps = self._column(values), self._column(times)
            indices = self._column("image_event_indices") if group == "images" else None
            for k in range(count):
                plane = stack[k] if indices is None else stack[k, :, :, 0]
                frame = frames.create_dataset(f"{name}{k:09d}", data=plane)
                frame.attrs["size"], frame.attrs["timestamp"] = plane.shape, stamps[k, 0]
                if indices is not None:
                    frame.attrs["type"], frame.attrs["event_idx"] = "greyscale", indices[k, 0]


def is_recording(path: Path) -> bool:
    """Tell whether a folder has one HDF5 file of this layout."""
    files = list(path.glob("*.h5"))
    if len(files) != 1:
        return False
    try:
        with h5py.File(files[0], "r") as file:
            return "events/ts" in file and "events/xs" in file
    except OSError:
        return False


def read_recording(path: Path) -> Recording:
    """Open the HDF5 file of a folder; may raise anything where it is damaged.

    Colour images, which event_utils allows, are left out.
    """
    (source,) = path.glob("*.h5")
    with h5py.File(source, "r") as file:
        images, flows = (_times(file, group) for group in ("images", "flow"))
        height, width = (int(side) for side in file.attrs["sensor_resolution"][:2])
        told = json.loads(file.attrs["camera"]) if "camera" in file.attrs else {"width": width, "height": height}
        if not isinstance(told, dict):
            raise ValueError("its camera is no table")
    names = {*(["image"] if images else []), *(["flow"] if flows else [])}
    times = sorted({*images, *flows})
    about = About(
        width=width,
        height=height,
        camera=told,
        names=tuple(name for name in TRUTH_NAMES if name in names),
        frame_rate=rate_of(times),
    )

    def events() -> Iterator[EventBatch]:
        with h5py.File(source, "r") as file:
            columns = [file[f"events/{name}"] for name in ("ts", "xs", "ys", "ps")]
            if any(column.ndim != 1 for column in columns) or len(set(map(len, columns))) > 1:
                raise ValueError(
                    f"events have the shapes {[column.shape for column in columns]}, expected one row each"
                )
            last_us = None
            for start in range(0, len(columns[0]), CHUNK_EVENTS):
                t, x, y, p = (column[start : start + CHUNK_EVENTS] for column in columns)
                if min(x.min(), y.min()) < 0 or x.max() >= width or y.max() >= height:
                    raise ValueError(f"events lie outside the sensor's {width}x{height} pixels")
                batch = empty_batch(len(t))
                batch["t"], batch["x"], batch["y"], batch["on"] = microseconds(t), x, y, p > 0
                if (np.diff(batch["t"], prepend=batch["t"][0] if last_us is None else last_us) < 0).any():
                    raise ValueError("events are not in the order of time")
                last_us = batch["t"][-1]
                yield batch

    def shots() -> Iterator[Shot]:
        flow_times = sorted(flows)
        after = dict(pairwise(flow_times))
        step_us = flow_times[-1] - flow_times[-2] if len(flow_times) > 1 else round(1e6 / about.frame_rate)
        with h5py.File(source, "r") as file:
            for time_us in times:
                planes: dict[str, npt.NDArray[Any]] = {}
                after_us = time_us
                if time_us in images:
                    image = held(file[images[time_us]])
                    if image.dtype != np.uint8:
                        raise ValueError(f"{images[time_us]} holds {image.dtype}, expected uint8")
                    planes["image"] = image.reshape(height, width)
                if time_us in flows:
                    after_us = after.get(time_us, time_us + step_us)
                    planes["flow"] = _flow(held(file[flows[time_us]]), (after_us - time_us) * 1e-6)
                # Times of frames lie anywhere between events: half a microsecond before is before all at that time.
                index = _index_at(file["events/ts"], time_us * 1e-6 - 5e-7)
                yield Shot(time_us, time_us, after_us, index, planes)

    return Recording(about, events, shots=shots)


def _times(file: Any, group: str) -> dict[int, str]:
    """Return where the frames of a group are, by their times [µs]; those in colour are left out."""
    found = {}
    for name, frame in file.get(group, {}).items():
        if group == "flow" or frame.ndim == 2 or frame.shape[2:] == (1,):
            found[int(microseconds([float(frame.attrs["timestamp"])])[0])] = f"{group}/{name}"
    return found


def _flow(speed: npt.NDArray[Any], seconds: float) -> npt.NDArray[np.float32]:
    """Return displacements ``[H, W, 4]`` with valid, and covisible, which nobody knows, of px/s ``[2, H, W]``."""
    known = np.any(speed != 0, axis=0)
    x, y = speed.astype(np.float64) * seconds
    return np.stack([x, y, known, np.zeros_like(known)], axis=-1).astype(np.float32)


def _index_at(column: Any, time_s: float) -> int:
    """Return the index of the first event at or after a time, of a sorted column that need not fit memory."""
    low, high = 0, len(column)
    while low < high:
        middle = (low + high) // 2
        low, high = (middle + 1, high) if column[middle] < time_s else (low, middle)
    return low


def open_layout(path: Path, about: About) -> EventUtilsLayout:
    """Open a writer of the layout."""
    return EventUtilsLayout(path, about)
