"""A look ahead: ten samples on a sheet, and what all sequences will cost, measured for a minute."""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.datasets.job import read_done, run_job, sequence_folder
from clsim.datasets.load import Sequence
from clsim.datasets.spec import Spec

SAMPLES = 10
_MEASURED_S = 60.0
_COLUMNS = 5
SHEET = "contact-sheet.png"
_SHOWN_US = 15_000
"""Time before and after the middle of which events are shown; less where they would cover everything."""
_PIXELS_AN_EVENT = 6


@dataclass(frozen=True)
class Preview:
    """What a data set will cost, by the sequences that were made.

    Attributes:
        sheet: the picture: of each sample what the camera saw, and up to 30 ms of events beside it.
        samples: how many were made.
        cpu_hours: processor time of all sequences.
        hours: time of all on this machine.
        gigabytes: size of all.
        rejected: attempts that were not kept.
        warnings: what sequences ask for and do not get, each sentence once.
    """

    sheet: str
    samples: int
    cpu_hours: float
    hours: float
    gigabytes: float
    rejected: int
    warnings: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return all values by name."""
        return asdict(self)

    @property
    def sentences(self) -> tuple[str, ...]:
        """What the user wants to know."""
        lost = f"; attempts that were not kept: {self.rejected}" if self.rejected else ""
        return (
            f"{self.samples} {'sample is' if self.samples == 1 else 'samples are'} on {self.sheet}{lost}",
            f"all sequences will take about {_time_text(self.cpu_hours)} of CPU time, {_time_text(self.hours)} on this "
            f"machine, and {_size_text(self.gigabytes)}; kernels that are new are compiled first",
        )


def _time_text(hours: float) -> str:
    """Return ``3.4 seconds`` for what is short."""
    for unit_hours, unit in ((1.0, "hours"), (1 / 60, "minutes")):
        if hours >= 1.5 * unit_hours:
            return f"{_rounded(hours / unit_hours)} {unit}"
    return f"{_rounded(hours * 3600)} seconds"


def _size_text(gigabytes: float) -> str:
    return f"{_rounded(gigabytes)} GB" if gigabytes >= 1 else f"{_rounded(gigabytes * 1e3)} MB"


def _rounded(value: float) -> str:
    """Return two digits of a number, without an exponent."""
    return f"{float(f'{value:.2g}'):,.10g}"


def preview(spec: Spec, out: Path, workers: int | None, longest_s: float = _MEASURED_S) -> Preview:
    """Make up to ten sequences, for a minute or ``longest_s``, put them on a sheet in ``out``, and throw them away.

    Raises:
        InputError: a sample makes no scene or run.
    """
    out.mkdir(parents=True, exist_ok=True)
    cpu_s = size = 0.0
    made = rejected = 0
    tiles: list[npt.NDArray[np.uint8]] = []
    warnings: dict[str, None] = {}
    truth = spec.run.get("truth", ())
    names = (truth,) if isinstance(truth, str) else tuple(truth)
    shown = replace(spec, run=spec.run | {"truth": [*names, "intensity"]}, layout="h5")
    begun = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="clsim-preview-") as folder:
        run_job(replace(shown, run=shown.run | {"frame_count": 2, "duration_s": None}), 0, f"{folder}/warm", None)
        for index in range(min(SAMPLES, spec.count)):
            done = run_job(shown, index, folder, None)
            made += 1
            cpu_s += done.cost["cpu_s"]
            size += sum(each for each, _ in done.files.values())
            rejected += len(done.rejected)
            warnings |= dict.fromkeys(done.warnings)
            place = sequence_folder(Path(folder), index)
            if done.kept and read_done(place) is not None:
                with Sequence(place) as sequence:
                    tiles.append(_tile(sequence))
            shutil.rmtree(place, ignore_errors=True)
            if time.monotonic() - begun > longest_s:
                break
    sheet = out / SHEET
    _write_sheet(tiles, sheet)
    total = spec.count / made
    cores = os.cpu_count() or 1
    return Preview(
        str(sheet), made, cpu_s * total / 3600, cpu_s * total / 3600 / min(cores, workers or cores), size * total / 1e9,
        rejected, tuple(warnings),
    )  # fmt: skip


def _tile(sequence: Sequence) -> npt.NDArray[np.uint8]:
    """Return what the camera saw in the middle, and the events about that time, side by side ``[H, 2W, 3]``."""
    middle = len(sequence.frame_times_us) // 2
    light = np.maximum(np.asarray(sequence.truth("intensity", middle), np.float64), 0)
    grey = (np.clip(light / max(float(np.percentile(light, 95)), 1e-9), 0, 1) ** (1 / 2.2) * 255).astype(np.uint8)
    time_us = int(sequence.frame_times_us[middle])
    events = sequence.events(max(0, time_us - _SHOWN_US), time_us + _SHOWN_US)
    most = sequence.width * sequence.height // _PIXELS_AN_EVENT
    near = int(np.searchsorted(events["t"], time_us))
    events = events[max(0, near - most // 2) : near + most // 2]
    seen = np.full((sequence.height, sequence.width, 3), 255, np.uint8)
    seen[events["y"], events["x"]] = np.where(events["on"][:, None], (200, 40, 30), (40, 70, 200))
    return np.concatenate([np.repeat(grey[..., None], 3, axis=2), seen], axis=1)


def _write_sheet(tiles: list[npt.NDArray[np.uint8]], path: Path) -> None:
    from PIL import Image

    if not tiles:
        tiles = [np.full((8, 8, 3), 255, np.uint8)]
    height, width = (max(tile.shape[axis] for tile in tiles) for axis in (0, 1))
    rows = -(-len(tiles) // _COLUMNS)
    sheet = np.full((rows * (height + 4), min(len(tiles), _COLUMNS) * (width + 4), 3), 230, np.uint8)
    for k, tile in enumerate(tiles):
        y, x = k // _COLUMNS * (height + 4), k % _COLUMNS * (width + 4)
        sheet[y : y + tile.shape[0], x : x + tile.shape[1]] = tile
    part = path.with_name(f".{path.name}.part.png")
    Image.fromarray(sheet).save(part)
    os.replace(part, path)
