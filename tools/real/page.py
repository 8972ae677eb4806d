"""The page of docs/real-cameras.md, from what was measured."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from clsim.sensor.statistics import Statistics
from tools.real.scene import Look
from tools.real.streams import Taken
from tools.real.two_samples import LEAST_EVENTS, OF_CAMERAS, OF_SCENES, PATCH_PX, PATCH_US

ROWS = (
    ("events", "events", True),
    ("events_per_pixel_s", "events a pixel and second", True),
    ("active_share", "active pixels", True),
    ("on_share", "share of ON", True),
    ("interval_us", "interval of a pixel [µs]: 1, 50, 99 %", True),
    ("opposite_next", "next of opposite sign", True),
    ("hottest", "events of the hottest hundredth", True),
    ("shared_time", "**share their µs**", False),
    ("row_mates", "**row-mates**", False),
    ("column_mates", "**column-mates**", False),
    ("one_row", "**of one time, in one row**", False),
    ("one_column", "**of one time, in one column**", False),
    ("lonely", "**lonely**", False),
)
"""Name, what it is called, and whether it is a scene's more than a camera's."""
DECIDED_BY_CAMERAS = tuple(name for name, _, of_scene in ROWS if not of_scene)


@dataclass(frozen=True)
class Compared:
    """A recording beside streams of models: of each the stream, its statistics, distances, and how well it is told."""

    file: str
    camera: str
    preset: str
    look: Look
    real: Statistics
    halves: tuple[float, float]
    patches: int
    models: Mapping[str, tuple[Taken, Statistics, Mapping[str, Any], tuple[float, float]]]


def page(compared: Sequence[Compared], minutes: float) -> str:
    """Return the page."""
    scenes, cameras = "; ".join(OF_SCENES), "; ".join(OF_CAMERAS)
    head = _HEAD.format(scenes=scenes, cameras=cameras, ms=PATCH_US // 1000, px=PATCH_PX, least=LEAST_EVENTS)
    parts = [head, _summary(compared), *map(_recording, compared), _TAIL.format(minutes=minutes)]
    return "\n".join(parts)


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head), *("| " + " | ".join(row) + " |" for row in rows)]
    return "\n".join(lines) + "\n"


def _summary(compared: Sequence[Compared]) -> str:
    models = list(compared[0].models)
    rows = []
    for each in compared:
        for name in DECIDED_BY_CAMERAS:
            apart = [each.models[model][2][name] for model in models]
            known = [far for far in apart if far is not None]
            rows.append(
                [each.file, {key: text for key, text, _ in ROWS}[name].strip("*")] + [_far(far, known) for far in apart]
            )
    told = [
        [each.file, seen, f"{each.halves[k]:.2f}", *(f"{each.models[model][3][k]:.2f}" for model in models)]
        for each in compared
        for k, seen in enumerate(("all", "cameras'"))
    ]
    return (
        "## How far from the recording\n\nThe table has differences between shares of a stream and of the recording,"
        " for the statistics that depend more on the camera than on the scene. The nearest stream is bold.\n\n"
        + _table(["recording", "statistic", *models], rows)
        + _nearest(rows, models)
        + "\nThe table has the share of patches that the line assigns correctly, to the stream or to the recording; .5 "
        "is chance. *Halves*: the same for the first and the second half of the recording, where .5 is expected.\n\n"
        + _table(["recording", "features", "halves", *models], told)
    )


def _nearest(rows: Sequence[Sequence[str]], models: Sequence[str]) -> str:
    counts = (f"{name} in {sum(row[2 + k].startswith('**') for row in rows)}" for k, name in enumerate(models))
    return f"\nThe nearest, with ties counted for each: {', '.join(counts)}, of {len(rows)} rows.\n"


def _far(far: float | None, known: Sequence[float]) -> str:
    if far is None:
        return "none"
    text = f"{far:.3f}"
    return f"**{text}**" if far == min(known) else text


def _recording(each: Compared) -> str:
    rows = []
    for name, text, _ in ROWS:
        values = [getattr(each.real, name), *(getattr(model[1], name) for model in each.models.values())]
        rows.append([text, *map(_value, values)])
    rows.append(["lost by the readout", "unknown", *(str(model[0].lost) for model in each.models.values())])
    rows.append(["speed of the texture [pixels/s]", "", *(f"{model[0].speed:.0f}" for model in each.models.values())])
    look = each.look
    return (
        f"## {each.camera}: {each.file}\n\n`--sensor {each.preset}`; {look.contrast:g} ln units of contrast, patches of"
        f" {look.patch_px:g} pixels, in {look.active:.0%} of the picture. {each.patches} patches for the line.\n\n"
        + _table(["", "real", *each.models], rows)
    )


def _value(value: Any) -> str:
    if value is None:
        return "none"
    if isinstance(value, tuple):
        return ", ".join(f"{each:.0f}" for each in value)
    if isinstance(value, int):
        return str(value)
    return f"{value:.3f}" if math.isfinite(value) and value < 10 else f"{value:.1f}"


_HEAD = """# Held against real cameras

This page compares simulated streams with recordings of real cameras. Each recording is compared with three simulated
streams that have the same number of events in the same time: of the ideal pixel, of the camera's preset, and of v2e.
v2e is simulated by its published equations, with the defaults of its command line and one frame for each pixel of
motion.

*Read this first.* The simulated scene is not the recorded one. A texture of dark and bright patches drifts in a part
of the picture, before pixels at some 100 lux. The texture's speed is chosen so that the stream has as many events as
the recording. If a model fires fewer events at any speed, the row *events* shows that. How fast light changes, how
much of it rises and where it changes depend on the scene, not on the camera: the rows in plain letters show such
quantities. Rows in **bold** letters depend more on the camera than on the scene. Some numbers of the presets were
read from these same recordings (`[sources]` says which). So a preset that fits its recording need not fit another
camera, or one with other biases.

The statistics are those of `clsim info RECORDING --statistics` ([what they are](stream-statistics.md)). Row-mates and
column-mates depend on the order of events of the same time. For this page all streams are sorted by time, row and
column. In the order of the recordings' own files, row-mates are .95, .96, 1.00 and .11.

At millions of events a second, row-mates say little, because neighbouring events have the same time anyway. The share
of events of the same time that lie in one row shows whether rows are read together.

The *line* is a linear classifier, Fisher's discriminant, that tries to separate patches of a stream from patches of
the recording. It uses patches of {ms} ms and {px}×{px} pixels with at least {least} events, with five-fold
cross-validation. Features of a patch that depend on the scene: {scenes}. Features that depend on the camera:
{cameras}.
"""
_TAIL = """## Left out

`dvs-320x240.es` is not a recording of a camera. In its first millisecond all 76,800 pixels but 15 fire, all of them
ON. No pixel ever fires twice in one millisecond, and all times are whole milliseconds. The file was made from frames.

## Again

```sh
# {minutes:.0f} minutes on two cores of a busy machine
python -m tools.real_cameras ../shared/real docs/real-cameras.md
```
"""
