"""``clsim info``: what a scene, a folder of frames or an event file is."""

from __future__ import annotations

import json
import os
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from clsim.cli.options.shared import JSON, STRICT_ORDER
from clsim.cli.output.words import dropped_text, moved_text
from clsim.errors import InputError

if TYPE_CHECKING:
    from clsim.scene import World
    from clsim.sensor.statistics import Statistics

_PICTURE_SIDE, _PICTURE_SPP = 64, 64
_LABELS = {"built in": "compiled", "left out": "not needed here, so not compiled:"}
"""What people read where a key of the JSON could be taken for something else."""


def info(
    what: Annotated[
        str,
        typer.Argument(
            help="A bundled scene, a scene file, EXR frames, a video or pictures, an event file or folder, a data set."
        ),
    ],
    statistics: Annotated[
        bool, typer.Option("--statistics", help="Of a recording: intervals, shared times, lonely events and more.")
    ] = False,
    against: Annotated[
        str | None, typer.Option(metavar="RECORDING", help="How far its statistics are from those of this one.")
    ] = None,
    as_json: JSON = False,
    strict: STRICT_ORDER = False,
) -> None:
    """Describe a scene and what of the renderer is compiled for it, frames and their features, video, or events.

    Examples: `clsim info two-boxes`, `clsim info run.aedat4 --statistics --against real.raw`
    """
    facts = _facts(what, strict)
    if statistics or against is not None:
        facts |= _statistics(what, facts, against)
    if as_json:
        typer.echo(json.dumps(facts))
        return
    for sentence in facts.get("scene", {}).get("warnings", ()):
        typer.echo(f"warning: {sentence}")
    for title, table in facts.items():
        typer.echo(title)
        for key, value in table.items():
            if key != "warnings":
                typer.echo(f"  {_LABELS.get(key, key):<20} {_text(value)}")
    if moved := facts.get("events", {}).get("moved_events"):
        typer.echo(f"clsim: {what}: {moved_text(moved)}", err=True)
    if dropped := facts.get("events", {}).get("dropped_events"):
        typer.echo(f"clsim: {what}: {dropped_text(dropped)}", err=True)


def _facts(what: str, strict: bool) -> dict[str, Any]:
    from clsim.datasets.manifest import DATASET
    from clsim.events.files import READ_ENDINGS, read_format_of, split_topic
    from clsim.footage.open import FILE_ENDINGS, is_footage
    from clsim.scene import bundled_scenes
    from clsim.truth.recording import recording_kind

    name = str(split_topic(what)[0]).lower()
    if os.path.isdir(what) and (kind := recording_kind(what)) is not None:
        return {"events": _events(what, kind.name, strict)} | _truth(what)
    if what not in bundled_scenes() and os.path.isfile(Path(what, DATASET)):
        return {"data set": _data_set(Path(what))}
    if name.endswith(FILE_ENDINGS) or (what not in bundled_scenes() and Path(what).is_dir() and is_footage(what)):
        return {"footage": _footage(what)}
    if name.endswith(".exr") or (Path(what).is_dir() and what not in bundled_scenes()):
        return {"frames": _frames(what)}
    if name.endswith(READ_ENDINGS):
        return {"events": _events(what, read_format_of(split_topic(what)[0]).name, strict)} | _truth(what)
    return _scene(what)


def _scene(what: str) -> dict[str, Any]:
    from clsim.live.quality import DEFAULT, QUALITIES
    from clsim.render import RenderOptions, describe_build
    from clsim.scene import describe, load_world

    world, point = load_world(what), QUALITIES[DEFAULT]
    cached = point.sampling == "cached"
    options = RenderOptions(first_hit_rays=point.first_hit_rays, sampler=point.sampler, light_cache=cached)
    facts = describe(world) | {"illuminance_lux": _illuminance_lux(world)}
    return {"scene": facts, "renderer": describe_build(world, options)}


def _illuminance_lux(world: World) -> dict[str, float]:
    """Return the illuminance of the sensor in the first frame: one pixel in a hundred is darker, one brighter.

    Found in a small picture: noise of the renderer makes the range a little wider.
    """
    from clsim.detect.features import LUMINANCE_WEIGHTS
    from clsim.frames import RADIANCE, Frame, page_aligned
    from clsim.render import RenderOptions, SceneData, View

    scale = _PICTURE_SIDE / max(world.camera.width, world.camera.height)
    width, height = (max(1, round(scale * side)) for side in (world.camera.width, world.camera.height))
    options = RenderOptions(spp=_PICTURE_SPP)
    camera = replace(world.camera, width=width, height=height)
    view = View(SceneData(world, options.device, options.tree), options, camera=camera)
    frame = Frame(page_aligned((len(view.names), height, width)), view.names)
    view.fill_at(0, 0, frame)
    view.close()
    luminance = np.tensordot(LUMINANCE_WEIGHTS["rec709"], [frame.plane(name) for name in RADIANCE], 1)
    darkest, middle, brightest = np.percentile(luminance, (1, 50, 99)) * world.sensor.lux_per_unit
    return {"dark": float(darkest), "median": float(middle), "bright": float(brightest)}


def _frames(what: str) -> dict[str, Any]:
    """Return what the files hold, and what `clsim detect --features auto` makes of the first one."""
    from clsim.detect.config import DetectorConfig
    from clsim.detect.features import FEATURE_PLANES, feature_names
    from clsim.detect.pack import first_features
    from clsim.frames import Frame, page_aligned
    from clsim.frames.exr import ExrSequence

    source = ExrSequence(what, fps=1.0)
    try:
        fps = source.recorded_fps if len(source.files) > 1 else None
    except InputError:
        fps = None
    first = Frame(page_aligned((len(source.names), source.height, source.width)), source.names)
    source.fill(0, first)
    candidates = feature_names(DetectorConfig(), source.names)
    used = first_features(first, candidates)
    left_out = {name: "constant in the first frame" for name in candidates if name not in used}
    left_out |= {name: "not in the files" for name in FEATURE_PLANES if name not in source.names}
    return {
        "layout": source.layout,
        "resolution": [source.width, source.height],
        "frames": len(source.files),
        "fps": fps,
        "planes": list(source.names),
        "features_used": ["pixel x", "pixel y", *used],
        "features_left_out": left_out,
        "invalid_pixels": int((~np.isfinite(first.planes)).any(axis=0).sum()),
    }


def _footage(what: str) -> dict[str, Any]:
    """Return what a video or a folder of pictures is, as its first frame and its header tell."""
    from clsim.footage.images import ENDINGS
    from clsim.footage.open import open_footage
    from clsim.footage.source import Reading
    from clsim.footage.video import Video

    pictures = Path(what).is_dir() or what.lower().endswith(ENDINGS)  # which have no rate of their own
    source = open_footage(what, Reading(fps=1.0 if pictures else None))
    try:
        return {
            "resolution": [source.width, source.height],
            "frames": source.frame_count,
            "fps": source.fps if isinstance(source, Video) else None,
            "transfer": source.transfer,
            "steps": source.steps,
        }
    finally:
        source.close()


def _data_set(folder: Path) -> dict[str, Any]:
    """Return what a folder of `clsim dataset` holds, by its sequences' own job.json."""
    from clsim.datasets.manifest import read_about, scan

    about, found = read_about(folder), list(scan(folder))
    kept = [done for done in found if done.kept]
    splits = dict.fromkeys(about.get("split", ()), 0) | Counter(done.split for done in kept if done.split)
    return {
        "name": about.get("name"),
        "sequences": len(kept),
        "rejected": len(found) - len(kept),
        "splits": splits,
        "events": sum(done.figures.get("events", 0) for done in kept),
        "bytes": sum(size for done in found for size, _ in done.files.values()),
    }


def _events(what: str, form: str, strict: bool) -> dict[str, Any]:
    """Return the figures of an event file or folder of that format, read in bounded memory."""
    from clsim.events.files import open_source

    count = on = right = bottom = last_us = 0
    first_us: int | None = None
    with open_source(what, strict=strict) as source:
        for batch in source:
            first_us = int(batch["t"][0]) if first_us is None else first_us
            last_us = int(batch["t"][-1])
            count += len(batch)
            on += int(batch["on"].sum())
            right, bottom = max(right, int(batch["x"].max())), max(bottom, int(batch["y"].max()))
        resolution = None if source.width is None or source.height is None else [source.width, source.height]
        labels = list(source.labelled)
    span_us = last_us - (first_us or 0)
    return {
        "format": source.format or form,
        "resolution": resolution,
        "events": count,
        "first_us": first_us,
        "last_us": last_us if count else None,
        "duration_s": span_us * 1e-6,
        "events_per_s": count / (span_us * 1e-6) if span_us else None,
        "on_share": on / count if count else None,
        "farthest_pixel": [right, bottom] if count else None,
        "moved_events": source.moved_events,
        "dropped_events": source.dropped_events,
    } | ({"labels": labels} if labels else {})


def _truth(what: str) -> dict[str, Any]:
    """Return what is recorded beside the events, if anything is."""
    from clsim.truth.recording import read_recording, recording_kind

    kind = recording_kind(what)
    if kind is None:
        return {}
    try:
        about = read_recording(what).about
    except InputError as error:
        return {"truth": {"layout": kind.name, "unreadable": str(error)}}
    facts = {"layout": kind.name, "holds": list(about.names), "frames_per_s": about.frame_rate}
    return {"truth": facts | ({"objects": list(about.objects)} if about.objects else {})}


def _statistics(what: str, facts: dict[str, Any], against: str | None) -> dict[str, Any]:
    """Return the statistics of a recording, and how far they are from those of another one."""
    from clsim.sensor.statistics import distances

    option = "--statistics" if against is None else "--against"
    if "events" not in facts:
        raise InputError(f"{option} is for recordings of events, and {what} is none")
    own = _statistics_of(what, facts["events"])
    if against is None:
        return {"statistics": own.as_dict()}
    others = _facts(against, False)
    if "events" not in others:
        raise InputError(f"--against {against}: is no recording of events")
    other = _statistics_of(against, others["events"])
    apart = distances(own, other)
    return {"statistics": own.as_dict(), "against": other.as_dict(), "distances": apart}


def _statistics_of(what: str, facts: dict[str, Any]) -> Statistics:
    from clsim.events.files import open_source
    from clsim.sensor.statistics import MOST_EVENTS, read_statistics

    width, height = facts["resolution"] or (None, None)
    with open_source(what) as source:
        found, more = read_statistics(source, width, height)
    if more:
        typer.echo(f"clsim: {what}: statistics are of its first {MOST_EVENTS} events", err=True)
    return found


def _text(value: Any) -> str:
    if value is None:
        return "unknown"
    if isinstance(value, dict):
        return ", ".join(f"{key} {_text(item)}" for key, item in value.items()) or "none"
    if isinstance(value, list | tuple):
        return ", ".join(map(_text, value)) or "none"
    return f"{value:g}" if isinstance(value, float) else str(value)
