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
        + "\nThe next table has the share of blocks that the classifier assigns correctly, to the stream or to the "
        "recording; by chance it is .5. *Halves* is this share for the first half of the recording against the second "
        "half, where .5 is expected. *Cameras'* are the features that depend on the camera.\n\n"
        + _table(["recording", "features", "halves", *models], told)
    )


def _nearest(rows: Sequence[Sequence[str]], models: Sequence[str]) -> str:
    counts = (f"{name} in {sum(row[2 + k].startswith('**') for row in rows)}" for k, name in enumerate(models))
    return f"\nThe nearest stream is: {', '.join(counts)}, of {len(rows)} rows. A tie counts for each.\n"


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
        f"## {each.camera}: {each.file}\n\nThe preset is `{each.preset}`. The texture has a contrast of "
        f"{look.contrast:g} natural-log units and spots of {look.patch_px:g} pixels, and moves in {look.active:.0%} of "
        f"the picture. The classifier had {each.patches} blocks of the recording.\n\n"
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

*Read this first.* The simulated scene is not the recorded one. A texture of dark and bright spots drifts in a part of
the picture, before pixels at some 100 lux. The texture's speed is chosen so that the stream has as many events as the
recording. If a model fires fewer events at any speed, its number in the row *events* is smaller. How fast light
changes, how much of it rises and where it changes depend on the scene, not on the camera: the rows in plain letters
show such quantities. Rows in **bold** letters depend more on the camera than on the scene. Some numbers of the presets
were read from these same recordings (`[sources]` marks them). So a preset that fits its recording need not fit another
camera, or one with other biases.

The statistics are those of `clsim info RECORDING --statistics`; [another page](stream-statistics.md) defines them. The
tables call `shared_time` *share their µs*, `one_row` and `one_column` *of one time, in one row* (*column*), and
`opposite_next` *next of opposite sign*. Row-mates and column-mates depend on the order of events of the same time. For
this page all streams are sorted by time, row and column. In the order of the recordings' own files, the share of
row-mates is .95, .96, 1.00 and .11.

At millions of events a second, neighbouring events have the same time anyway, so row-mates are no sign that rows are
read together. `one_row` is such a sign.

A *linear classifier*, Fisher's discriminant, tries to separate a simulated stream from the recording. It gets blocks
of {ms} ms and {px}×{px} pixels with at least {least} events, in five-fold cross-validation. Features of a block that
depend on the scene: {scenes}. Features that depend on the camera: {cameras}.
"""
_TAIL = """## Left out

`dvs-320x240.es` is not a recording of a camera. In its first millisecond all 76,800 pixels but 15 fire, all of them
ON. No pixel ever fires twice in one millisecond, and all times are whole milliseconds. The file was made from frames.

## Again

```sh
# {minutes:.0f} minutes on two cores of a busy machine
python -m tools.real.real_cameras ../shared/real docs/real-cameras.md
```
"""
