"""clsim's own layout: one HDF5 file, whose events any reader of DSEC reads.

====================  ==========================================================================================
/events, /ms_to_idx   as DSEC has them (`clsim.events.formats.tables.hdf5`)
/frames/t             time of each frame of truth [µs], int64 ``[n]``
/frames/event_index   index of the first event at or after it, int64 ``[n]``
/frames/flow_end      where forward flow leads to [µs], int64 ``[n]``; backward flow leads to ``flow_start``
/frames/NAME          ``[n, H, W]`` or ``[n, H, W, 2 or 3]``, a chunk a frame, compressed
/objects, /materials  names, number k of a plane of ids at k − 1; pose at time 0 of each object
/poses/NAME           ``t``, ``pose`` x y z qx qy qz qw, ``velocity`` for the camera and each object that moves
/imu                  ``t``, ``acceleration``, ``angular_velocity``
====================  ==========================================================================================

Attributes tell units, axes, signs and clocks. Each flush leaves a whole file behind.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.events import CAUSES, EventBatch
from clsim.events.formats.filesink import FlushPolicy
from clsim.events.formats.filesource import CHUNK_EVENTS
from clsim.events.formats.tables.hdf5 import Hdf5Sink, open_source
from clsim.events.formats.tables.hdf5_growing import compressed
from clsim.truth.labels import LABEL_DTYPE
from clsim.truth.names import TRUTH_NAMES
from clsim.truth.record import About, ImuChunk, ImuNoise, Layout, Shot, TrackChunk
from clsim.truth.recording import Recording
from clsim.truth.writing.lines import held
from clsim.version import VERSION

CONVENTIONS = (
    "times: int64 microseconds of the events' clock; images: row 0 on top, x right, y down, centre of the first pixel "
    "at (0.5, 0.5); lengths: metres; world: right-handed, +y up; camera: +z ahead, +x right, +y down (OpenCV); poses: "
    "body to world, x y z qx qy qz qw; velocity: linear in the world [m/s], then angular in the body's axes [rad/s]; "
    "imu: specific force [m/s^2] and angular rate [rad/s] in the camera's axes"
)

_PLANES: dict[str, tuple[tuple[int, ...], str, str, str]] = {
    "intensity": ((), "f4", "W sr^-1 m^-2", "Rec. 709 luminance of linear radiance, as rendered"),
    "image": ((), "u1", "1", "sRGB, with one exposure for the run"),
    "depth": ((), "f4", "m", "along the optical axis; inf where nothing is"),
    "distance": ((), "f4", "m", "along the ray; inf where nothing is"),
    "normal": ((3,), "f4", "1", "shading normal in the world, facing the camera; 0 where nothing is"),
    "albedo": ((3,), "f4", "1", "share of light reflected, linear Rec. 709; 0 where nothing is"),
    "object": ((), "u4", "1", "k is the object named objects/name[k - 1]; 0 where nothing is"),
    "material": ((), "u4", "1", "k is the material named materials/name[k - 1]; 0 where nothing is"),
}
"""Shape of a pixel, type, unit and meaning."""
_FLOWS = {
    "flow": ("from frames/t to frames/flow_end", "flow_end"),
    "backward_flow": ("from frames/t to frames/flow_start", "flow_start"),
}


class Hdf5Layout(Layout):
    """Writes the file."""

    def __init__(self, path: Path, about: About) -> None:
        """Create it; raises InputError when it cannot be."""
        self._about = about
        self._tracks: dict[str, str] = {}
        self._waiting: dict[str, list[npt.NDArray[Any]]] = {}
        self._sink = Hdf5Sink(path, about.width, about.height, FlushPolicy(), self._prepare)

    def events(self, batch: EventBatch, end_us: int) -> None:
        """Append events."""
        self._sink.write(batch, end_us)

    def labels(self, labels: npt.NDArray[np.void]) -> None:
        """Append labels; after a kill there may be fewer than events, by those of one frame of truth."""
        self._wait({f"events/{name}": labels[name] for name in LABEL_DTYPE.names or ()})

    def shot(self, shot: Shot) -> None:
        """Append a frame; rows of planes that it lacks say that nothing is known, so that numbers stay the same."""
        rows: dict[str, npt.NDArray[Any]] = {
            "frames/event_index": np.array([shot.event_index]),
        }
        for name in _planes_of(self._about):
            width, kind, *_ = _PLANES[name]
            rows[f"frames/{name}"] = self._plane(shot, name, width, np.nan if kind.startswith("f") else 0)
        for name, end, end_us in (
            ("flow", "flow_end", shot.after_us),
            ("backward_flow", "flow_start", shot.before_us),
        ):
            key = name.replace("_", "-")
            if key in self._about.names:
                flow = self._plane(shot, key, (4,), 0)
                rows[f"frames/{name}"] = flow[..., :2]
                rows[f"frames/{name}_valid"] = flow[..., 2] > 0
                rows[f"frames/{name}_covisible"] = flow[..., 3] > 0
                rows[f"frames/{end}"] = np.array([end_us])
        rows["frames/t"] = np.array([shot.time_us])
        self._flush(rows)

    def _plane(self, shot: Shot, name: str, width: tuple[int, ...], unknown: float) -> npt.NDArray[Any]:
        """Return a plane as one row, filled with ``unknown`` where the frame lacks it."""
        if name in shot.planes:
            return shot.planes[name][None]
        return np.full((1, self._about.height, self._about.width, *width), unknown)

    def track(self, chunk: TrackChunk) -> None:
        """Append poses."""
        group = self._tracks[chunk.name]
        self._wait({f"{group}/t": chunk.times_us, f"{group}/pose": chunk.poses, f"{group}/velocity": chunk.velocities})

    def imu(self, chunk: ImuChunk) -> None:
        """Append inertial samples."""
        self._wait(
            {
                "imu/t": chunk.times_us,
                "imu/acceleration": chunk.acceleration,
                "imu/angular_velocity": chunk.angular_velocity,
            }
        )

    def close(self) -> None:
        """Complete the file."""
        try:
            if self._waiting:
                self._flush({})
        finally:
            self._sink.close()

    def _wait(self, rows: Mapping[str, npt.NDArray[Any]]) -> None:
        """Keep rows for the next frame: each flush costs milliseconds, however little it has to write."""
        for name, values in rows.items():
            self._waiting.setdefault(name, []).append(values)

    def _flush(self, rows: Mapping[str, npt.NDArray[Any]]) -> None:
        waiting = {name: np.concatenate(parts) for name, parts in self._waiting.items()}
        self._waiting.clear()
        self._sink.append(waiting | dict(rows))

    def _prepare(self, file: Any) -> None:
        about = self._about
        file.attrs["layout"] = "clsim"
        file.attrs["clsim_version"] = VERSION
        file.attrs["conventions"] = CONVENTIONS
        file.attrs["camera"] = json.dumps(dict(about.camera))
        file.attrs["about"] = json.dumps(dict(about.more))
        file.attrs["side"], file.attrs["baseline_m"] = about.side, about.baseline_m
        file.attrs["camera_name"] = about.camera_name
        file.attrs["extrinsics"] = json.dumps({name: np.asarray(m).tolist() for name, m in about.extrinsics.items()})
        self._prepare_frames(file)
        for group, names in (("objects", about.objects), ("materials", about.materials)):
            if "ids" in about.names or (group == "objects" and {"poses", "labels"} & set(about.names)):
                file.create_dataset(f"{group}/name", data=list(names), dtype=_text_type())
        if "poses" in about.names:
            file["objects"].create_dataset("pose", data=about.object_poses)
            for number, name in enumerate(("camera", *about.moving)):
                self._tracks[name] = group = f"poses/{number:04d}" if number else "poses/camera"
                file.create_group(group).attrs["name"] = name
                _column(file, f"{group}/t", (), "i8", 1 << 12)
                _column(file, f"{group}/pose", (7,), "f8", 1 << 10)
                _column(file, f"{group}/velocity", (6,), "f8", 1 << 10)
        if "labels" in about.names:
            _column(file, "events/object", (), "u4", 1 << 14)
            _column(file, "events/cause", (), "u1", 1 << 14)
            file["events/cause"].attrs["causes"] = list(CAUSES)
            _column(file, "events/flow", (2,), "f4", 1 << 13)
            file["events/flow"].attrs["unit"] = "px/s, right and down; NaN where it is not known"
        if "imu" in about.names:
            imu = file.create_group("imu")
            imu.attrs["rate_hz"], imu.attrs["gravity"] = about.imu_rate, about.gravity
            for name, value in vars(about.imu_noise).items():
                imu.attrs[name] = value
            _column(file, "imu/t", (), "i8", 1 << 12)
            _column(file, "imu/acceleration", (3,), "f8", 1 << 11)
            _column(file, "imu/angular_velocity", (3,), "f8", 1 << 11)

    def _prepare_frames(self, file: Any) -> None:
        about = self._about
        size = about.height, about.width
        file.create_group("frames").attrs["rate_hz"] = about.frame_rate
        _column(file, "frames/t", (), "i8", 1 << 10)
        _column(file, "frames/event_index", (), "i8", 1 << 10)
        for name in _planes_of(about):
            width, kind, unit, meaning = _PLANES[name]
            _image(file, f"frames/{name}", (*size, *width), kind, unit, meaning)
        for name, (meaning, end) in _FLOWS.items():
            if name.replace("_", "-") in about.names:
                _image(file, f"frames/{name}", (*size, 2), "f4", "px", f"right and down, {meaning}")
                _image(file, f"frames/{name}_valid", size, "u1", "1", "whether the flow is known")
                _image(file, f"frames/{name}_covisible", size, "u1", "1", "whether the point is seen at both times")
                _column(file, f"frames/{end}", (), "i8", 1 << 10)


def _planes_of(about: About) -> list[str]:
    """Return the names of planes but flow's that frames have."""
    asked = {*about.names, *(("object", "material") if "ids" in about.names else ())}
    return [name for name in _PLANES if name in asked]


def is_recording(path: Path) -> bool:
    """Tell whether a file is of this layout, and not events alone."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            return bool(file.attrs.get("layout") == "clsim")
    except OSError:
        return False


def read_recording(path: Path) -> Recording:
    """Open a file of this layout; may raise anything where it is damaged."""
    import h5py

    with h5py.File(path, "r") as file:
        about = _read_about(file)

    def shots() -> Iterator[Shot]:
        with h5py.File(path, "r") as file:
            frames = file["frames"]
            columns = [key for key in (*_PLANES, *_FLOWS) if key in frames]
            count = min(len(frames[key]) for key in ("t", "event_index", *columns))
            for k in range(count):
                yield _read_shot(frames, k)

    def tracks() -> Iterator[TrackChunk]:
        with h5py.File(path, "r") as file:
            groups = file.get("poses", {})
            for group in (groups[key] for key in sorted(groups, key=lambda key: (key != "camera", key))):
                columns = [held(group[key]) for key in ("t", "pose", "velocity")]
                count = min(map(len, columns))
                yield TrackChunk(str(group.attrs["name"]), *(column[:count] for column in columns))

    def labels() -> Iterator[npt.NDArray[np.void]]:
        with h5py.File(path, "r") as file:
            events = file["events"]
            names = [name for name in LABEL_DTYPE.names or () if name in events]  # older versions had no causes
            count = min(len(events[key]) for key in ("t", *names)) if "object" in names else 0
            for start in range(0, count, CHUNK_EVENTS):
                stop = min(start + CHUNK_EVENTS, count)
                part = np.zeros(stop - start, LABEL_DTYPE)
                for name in names:
                    part[name] = events[name][start:stop]
                yield part

    def imu() -> Iterator[ImuChunk]:
        with h5py.File(path, "r") as file:
            if "imu" in file:
                columns = [held(file["imu"][key]) for key in ("t", "acceleration", "angular_velocity")]
                count = min(map(len, columns))
                yield ImuChunk(*(column[:count] for column in columns))

    return Recording(about, lambda: iter(open_source(path)), labels, shots, tracks, imu)


def _read_about(file: Any) -> About:
    frames = file["frames"]
    names = [name for name in TRUTH_NAMES if name.replace("-", "_") in frames]
    names += ["labels"] * ("object" in file["events"])
    names += ["ids"] * ("object" in frames) + ["poses"] * ("poses" in file) + ["imu"] * ("imu" in file)
    facts: dict[str, Any] = {}
    if "objects" in file:
        facts["objects"] = tuple(file["objects/name"].asstr()[:])
    if "materials" in file:
        facts["materials"] = tuple(file["materials/name"].asstr()[:])
    if "poses" in file:
        facts["object_poses"] = file["objects/pose"][:]
        facts["moving"] = tuple(str(g.attrs["name"]) for key, g in file["poses"].items() if key != "camera")
    if "imu" in file:
        attributes = file["imu"].attrs
        facts["imu_rate"] = float(attributes["rate_hz"])
        facts["gravity"] = tuple(map(float, attributes["gravity"]))
        facts["imu_noise"] = ImuNoise(**{field.name: float(attributes[field.name]) for field in fields(ImuNoise)})
    return About(
        width=int(file["events"].attrs["width"]),
        height=int(file["events"].attrs["height"]),
        camera=json.loads(file.attrs["camera"]),
        names=tuple(name for name in TRUTH_NAMES if name in names),
        frame_rate=float(frames.attrs["rate_hz"]),
        side=str(file.attrs["side"]),
        camera_name=str(file.attrs["camera_name"]),
        extrinsics={key: np.array(value) for key, value in json.loads(file.attrs["extrinsics"]).items()},
        baseline_m=float(file.attrs["baseline_m"]),
        more=json.loads(file.attrs["about"]),
        **facts,
    )


def _read_shot(frames: Any, k: int) -> Shot:
    planes: dict[str, npt.NDArray[Any]] = {}
    for name in _PLANES:
        if name in frames:
            kind = np.uint8 if name == "image" else np.float32
            planes[name] = held(frames[name], k).astype(kind)
    time_us = int(frames["t"][k])
    ends = {"flow_end": time_us, "flow_start": time_us}
    for name, (_, end) in _FLOWS.items():
        if name in frames:
            known = [held(frames[f"{name}_{part}"], k) for part in ("valid", "covisible")]
            flow = np.concatenate([held(frames[name], k), np.stack(known, axis=-1)], axis=-1)
            planes[name.replace("_", "-")] = flow.astype(np.float32)
            ends[end] = int(frames[end][k])
    return Shot(time_us, ends["flow_start"], ends["flow_end"], int(frames["event_index"][k]), planes)


def _text_type() -> Any:
    import h5py

    return h5py.string_dtype()


def _column(file: Any, name: str, width: tuple[int, ...], kind: str, rows: int) -> None:
    file.create_dataset(name, (0, *width), kind, maxshape=(None, *width), chunks=(rows, *width))


def _image(file: Any, name: str, shape: tuple[int, ...], kind: str, unit: str, meaning: str) -> None:
    dataset = compressed(file, name, shape, kind)
    dataset.attrs["unit"], dataset.attrs["meaning"] = unit, meaning


def open_layout(path: Path, about: About) -> Hdf5Layout:
    """Open a writer of the layout."""
    return Hdf5Layout(path, about)
