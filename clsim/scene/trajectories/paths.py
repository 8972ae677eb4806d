"""Camera paths from files: TUM and CSV text, npz arrays, and the camera of a glTF file."""

from __future__ import annotations

import csv
import math
import zipfile
from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.scene.driven import place_of
from clsim.scene.files import USD_ENDINGS, need_file, need_usd
from clsim.scene.motion import Motion
from clsim.scene.trajectories.trajectory import MAX_BYTES, Axes, Interpolation, Timed, joined, read_tum
from clsim.scene.world import World
from clsim.values import read_text

ENDINGS = (".txt", ".tum", ".csv", ".npz", ".glb", ".gltf", *USD_ENDINGS)
_NS = Decimal("1e-9")
_UNITS_S = {"s": Decimal(1), "sec": Decimal(1), "ms": Decimal("1e-3"), "us": Decimal("1e-6"), "ns": _NS}
_TIMES = ("t", "time", "timestamp")
_PLACE = ("x", "y", "z", "qx", "qy", "qz", "qw")
_ALIKE = {f"{prefix}{axis}": axis for prefix in ("p", "t", "p_", "t_", "p_rs_r_") for axis in "xyz"} | {
    f"{prefix}{axis}": f"q{axis}" for prefix in ("q_", "q_rs_") for axis in "xyzw"
}
_F64 = npt.NDArray[np.float64]


def read_path(path: Path, *, axes: Axes = "opencv", interpolation: Interpolation = "linear") -> Motion:
    """Read the poses of a camera, camera to world; time starts at the first of them.

    ``.txt`` and ``.tum`` are TUM's format. ``.csv`` has a header that names the columns x, y, z, qx, qy, qz, qw and a
    time with its unit, such as ``time_s``, ``timestamp_us`` or ``t_ns``, which may be a comment, as in EuRoC's files;
    ESIM's, without a header, has t [ns] first.
    ``.npz`` has a time likewise, ``[n]``, and ``poses`` ``[n, 4, 4]``, or ``positions`` ``[n, 3]`` with ``quaternions``
    x, y, z, w ``[n, 4]``. ``.glb``, ``.gltf`` and USD lend their first camera, with its own axes and interpolation.

    Args:
        path: the file.
        axes: the camera's: ``opencv`` looks along +z with y down; ``opengl`` along −z with y up.
        interpolation: how to join the poses.

    Raises:
        InputError: naming the file, and the line where there are any.
    """
    suffix = path.suffix.lower()
    if suffix not in ENDINGS:
        raise InputError(f"{path}: ends in {suffix or 'nothing'}, expected a camera path: {', '.join(ENDINGS)}")
    need_file(path, "a camera path")
    if suffix in (".glb", ".gltf"):
        from clsim.scene.gltf.scene import read_camera

        return read_camera(path).motion
    if suffix in USD_ENDINGS:
        need_usd(path)
        from clsim.scene.usd.scene import read_usd_camera

        return read_usd_camera(path).motion
    if suffix == ".csv":
        return joined(path, _read_csv(path), axes, interpolation)
    if suffix == ".npz":
        return joined(path, _read_npz(path), axes, interpolation)
    return read_tum(path, axes=axes, interpolation=interpolation)


def on_path(world: World, motion: Motion) -> World:
    """Return the world with its camera on a path; it lasts as long as the path, or all else if the path is one pose."""
    moved = replace(world, camera=replace(world.camera, motion=motion))
    rest_s = world.duration_s
    if rest_s == world.moving_s():
        # Nobody said how long, and what took longest may have been the camera's own motion.
        rest_s = moved.moving_s() or rest_s
    return replace(moved, duration_s=motion.duration_s or rest_s)


def _read_csv(path: Path) -> list[Timed]:
    lines = [(number, row) for number, row in enumerate(_rows(path), 1) if row]
    rows = [(number, row) for number, row in lines if not row[0].lstrip().startswith("#")]
    columns: tuple[str, ...] = ("t", *_PLACE)
    unit_s: Decimal | None = None
    if rows and not _is_number(rows[0][1][0]):
        number, header = rows.pop(0)
        columns, unit_s = _header(f"{path}:{number}", header)
    elif commented := [found for _, row in lines if row[0].lstrip().startswith("#") if (found := _commented(row))]:
        columns, unit_s = commented[0]
    poses = []
    for number, row in rows:
        place = f"{path}:{number}"
        if len(row) != len(columns) or not all(map(_is_number, row)):
            raise InputError(f"{place}: got {','.join(row)[:60]!r}, expected {len(columns)} finite numbers")
        named = dict(zip(columns, row, strict=True))
        poses.append((place, Decimal(named["t"]) * (unit_s or _NS), [float(named[name]) for name in _PLACE]))
    if unit_s is None:
        _check_ns(poses)
    return poses


def _check_ns(poses: list[Timed]) -> None:
    """Raise InputError where times without a unit can be no ns, which they are in ESIM's files."""
    short = 0 < poses[-1][1] - poses[0][1] < 1000 * _NS if poses else False
    for place, time_s, _ in poses[-1:] if short else poses:
        if short or (time_s / _NS).to_integral_value() != time_s / _NS:
            raise InputError(
                f"{place}: time {float(time_s / _NS):.9g} has no unit, and is none in ns; expected a header such as "
                "time_s,x,y,z,qx,qy,qz,qw"
            )


def _rows(path: Path) -> list[list[str]]:
    try:
        return list(csv.reader(read_text(path, MAX_BYTES, "a trajectory").splitlines()))
    except csv.Error as error:
        raise InputError(f"{path}: is not CSV ({error})") from None


def _header(place: str, header: list[str]) -> tuple[tuple[str, ...], Decimal]:
    """Return the columns by our names, and the unit of time [s]."""
    columns, units = _named(header)
    missing = [name for name in ("t", *_PLACE) if columns.count(name) != 1]
    if missing or not units:
        raise InputError(
            f"{place}: its columns are {', '.join(header)[:80]}, expected x, y, z, qx, qy, qz, qw and a time with its "
            "unit, such as time_s or timestamp_us"
        )
    return tuple(columns), units[0]


def _commented(header: list[str]) -> tuple[tuple[str, ...], Decimal | None] | None:
    """Return what `_header` does of a comment, in which a time may have no unit; None where it names none.

    EuRoC's files have w before x, y and z, and tell it in such a comment alone.
    """
    columns, units = _named([header[0].lstrip("# "), *header[1:]])
    if not units:
        columns = [("t" if name in _TIMES else name) for name in columns]
    whole = all(columns.count(name) == 1 for name in ("t", *_PLACE))
    return (tuple(columns), units[0] if units else None) if whole else None


def _named(header: list[str]) -> tuple[list[str], list[Decimal]]:
    """Return columns by our names, and the units of times among them [s]."""
    columns, units = [], []
    for cell in header:
        name = cell.strip().lower()
        unit = _unit_s(name)
        units += [unit] if unit else []
        bare = name.partition("[")[0].strip()
        columns.append("t" if unit else _ALIKE.get(bare, bare))
    return columns, units


def _unit_s(name: str) -> Decimal | None:
    """Return the unit of a column of times [s]; None where it is none, or has no unit in its name."""
    stem, _, unit = name.strip().rstrip("]").replace(" [", "_").replace("[", "_").rpartition("_")
    return _UNITS_S.get(unit) if stem in _TIMES else None


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def _read_npz(path: Path) -> list[Timed]:
    arrays = _arrays(path)
    times = [(name, unit) for name in arrays if (unit := _unit_s(name)) is not None]
    if len(times) != 1:
        raise InputError(
            f"{path}: holds {', '.join(arrays) or 'nothing'}, expected one array of times with its unit, such as time_s"
        )
    (name, unit_s), places = times[0], _places(path, arrays)
    times = arrays[name]
    if times.shape != (len(places),) or not np.isfinite(times).all():
        raise InputError(f"{path}: {name} has shape {times.shape}, expected {len(places)} finite numbers")
    told = [Decimal(time) * unit_s for time in times.tolist()]
    return [(f"{path}: pose {k}", told[k], places[k].tolist()) for k in range(len(places))]


def _arrays(path: Path) -> dict[str, Any]:
    """Return the arrays of numbers in the file, whose size is looked at before it is unpacked."""
    try:
        with zipfile.ZipFile(path) as packed:
            size = sum(item.file_size for item in packed.infolist())
        if size <= MAX_BYTES:
            with np.load(path, allow_pickle=False) as found:
                return {name: found[name] for name in found.files if found[name].dtype.kind in "fiu"}
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    # zipfile raises the last for packing that it lacks, and for what needs a password.
    except (ValueError, zipfile.BadZipFile, EOFError, RuntimeError) as error:
        raise InputError(f"{path}: is no npz of arrays ({' '.join(str(error).split())[:80]})") from None
    raise InputError(f"{path}: unpacks to more than {MAX_BYTES >> 20} MiB, expected a trajectory")


def _places(path: Path, arrays: dict[str, Any]) -> _F64:
    """Return position and quaternion of each pose, ``[n, 7]``."""
    if "poses" in arrays:
        poses = np.asarray(arrays["poses"], np.float64)
        if poses.ndim != 3 or poses.shape[1:] not in ((4, 4), (3, 4)):
            raise InputError(f"{path}: poses has shape {poses.shape}, expected n × 4 × 4")
        rows = []
        for k, pose in enumerate(poses):
            if np.abs(pose[3:, :3]).max(initial=0.0) > 1e-6:
                raise InputError(f"{path}: poses[{k}] has its position in the last row, expected the last column")
            try:
                position, quaternion, _ = place_of(np.vstack([pose[:3], (0.0, 0.0, 0.0, 1.0)]))
            except ValueError:
                raise InputError(f"{path}: poses[{k}] is no rotation and position") from None
            rows.append((*position, *quaternion))
        return np.array(rows).reshape(-1, 7)
    if "positions" not in arrays or "quaternions" not in arrays:
        raise InputError(f"{path}: holds {', '.join(arrays)}, expected poses, or positions and quaternions")
    positions, quaternions = (np.asarray(arrays[name], np.float64) for name in ("positions", "quaternions"))
    if positions.ndim != 2 or positions.shape[1:] != (3,) or quaternions.shape != (len(positions), 4):
        raise InputError(
            f"{path}: positions and quaternions have shapes {positions.shape} and {quaternions.shape}, "
            "expected n × 3 and n × 4"
        )
    return np.concatenate([positions, quaternions], axis=1)
