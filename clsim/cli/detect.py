"""``clsim detect``: recorded frames become events."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from clsim.cli import parse
from clsim.cli.options import (
    EVENT_RULE,
    FORMAT,
    HISTORY,
    JSON,
    METHOD,
    OPENCL,
    OUT_HELP,
    TEXT_TIME,
    WINDOW,
    advanced,
)
from clsim.detect.config import (
    Bandwidth,
    DetectorConfig,
    Gate,
    Kernel,
    Luminance,
    Precision,
    Regress,
    Response,
)
from clsim.errors import InputError


def detect(
    frames: Annotated[
        str,
        typer.Argument(
            help="Folder or glob pattern of EXR frames: ours, the ICIP 2023 program's, "
            "pbrt-v4's, Mitsuba 3's or Blender's."
        ),
    ],
    out: Annotated[list[str], typer.Option(help=OUT_HELP)],
    fps: Annotated[float | None, typer.Option(help="Frames per second. [the times in the files]")] = None,
    threshold: Annotated[
        str | None,
        typer.Option(help="Contrast threshold in natural-log units: 0.2, or ON,OFF: 0.2,0.25. [the frames', or 0.2]"),
    ] = None,
    as_json: JSON = False,
    method: METHOD = None,
    gate: Annotated[
        Gate | None,
        advanced(
            help="Where esim-ad solves its regression. delta-r-exact (to check delta-r) and published (the ICIP 2023 "
            "program's) keep old windows and run in numpy, slowly. [radiance]"
        ),
    ] = None,
    gate_scale: Annotated[float | None, advanced(help="s: the radiance gate opens beyond s·C. [1]")] = None,
    box: Annotated[int | None, advanced(help="Side of the radiance gate's box means [pixels], odd. [5]")] = None,
    event_rule: EVENT_RULE = None,
    window: WINDOW = None,
    stride: Annotated[int | None, advanced(help="Step between the window's samples [pixels], 1…3. [1]")] = None,
    history: HISTORY = None,
    kernel: Annotated[
        Kernel | None, advanced(help="Weight of a sample by its distance in feature space. [gaussian]")
    ] = None,
    bandwidth: Annotated[
        Bandwidth | None,
        advanced(
            help="fixed; or chosen per pixel: tsvd leaves out noisy directions of feature space, optimised also weighs "
            "bias against variance. Both need variance planes and run in numpy, slowly. [fixed]"
        ),
    ] = None,
    bandwidth_h: Annotated[float | None, advanced(help="Bandwidth h of the weights. [1]")] = None,
    ridge: Annotated[float | None, advanced(help="λ: how much β is penalised. [1e-5]")] = None,
    regress: Annotated[
        Regress | None,
        advanced(
            help="What is regressed: log brightness, as in the paper; or linear luminance, whose log is taken then: "
            "that of few samples is too low on average. [log]"
        ),
    ] = None,
    shrink: Annotated[
        float | None,
        advanced(
            help="How readily a pixel's own value counts where its window's residual is more than noise: 0 never, "
            "1.5 is good. Needs --regress linear and the plane Variance.Luminance. [0]"
        ),
    ] = None,
    response: Annotated[Response | None, advanced(help="Brightness of a luminance. [ln]")] = None,
    luminance: Annotated[Luminance | None, advanced(help="Weights of R, G and B. [rec709]")] = None,
    scale: Annotated[float | None, advanced(help="Factor on luminance. [the frames', or 1]")] = None,
    floor: Annotated[float | None, advanced(help="Smallest luminance after scaling. [the frames', or 1e-4]")] = None,
    features: Annotated[str | None, advanced(help="auto, or planes by name: Depth,Nx,Ny,Nz,Albedo.R … [auto]")] = None,
    precision: Annotated[Precision | None, advanced(help="Arithmetic of the regression. [float32]")] = None,
    opencl: OPENCL = None,
    format: FORMAT = None,
    text_time: TEXT_TIME = None,
) -> int:
    """Turn a sequence of EXR frames into events.

    Frames of `clsim render` tell in their frames.json which detector they were rendered for: that one is taken, as
    far as no option says otherwise, and the events are those of `clsim live`. Other frames get esim-ad.

    Example: `clsim detect frames --fps 60 --out events.aedat4`
    """
    from clsim.cli.status import run_session
    from clsim.events.address import is_standard_output
    from clsim.events.outputs import FileOptions
    from clsim.live.options import RecordingOptions
    from clsim.live.session import open_recording

    if as_json and any(map(is_standard_output, out)):
        raise InputError("--json and --out - would both write to standard output; give --out a file instead")
    on, off = (None, None) if threshold is None else parse.threshold(threshold)
    told = _told_by(frames)
    config = detector_config(
        frames,
        told,
        {
            "method": method,
            "gate": gate,
            "event_rule": event_rule,
            "threshold_on": on,
            "threshold_off": off,
            "window": window,
            "stride": stride,
            "history": history,
            "box": box,
            "gate_scale": gate_scale,
            "kernel": kernel,
            "bandwidth": bandwidth,
            "bandwidth_h": bandwidth_h,
            "ridge": ridge,
            "regress": regress,
            "shrink": shrink,
            "response": response,
            "luminance": luminance,
            "scale": scale,
            "floor": floor,
            "features": _features(features),
            "precision": precision,
        },
    )
    files = FileOptions(format, text_time)
    options = RecordingOptions(frames, config, fps, opencl, tuple(out), files, _fps_told(told))
    return run_session(open_recording(options), as_json=as_json)


def detector_config(frames: str, told: Mapping[str, Any], given: Mapping[str, Any]) -> DetectorConfig:
    """Return the detector's options: those ``given`` (None: not given), else those that frames.json ``told``."""
    from clsim.values import from_plain

    chosen = {name: value for name, value in given.items() if value is not None}
    detector = told.get("detector")
    try:
        base = from_plain(DetectorConfig, detector if isinstance(detector, dict) else {})
    except InputError as error:
        raise InputError(f"{_about(frames)}: {error}") from None
    if chosen.get("method", base.method) != base.method:
        base = replace(base, window=None)
    return replace(base, **chosen)


def _about(frames: str) -> Path:
    return (Path(frames) if Path(frames).is_dir() else Path(frames).parent) / "frames.json"


def _told_by(frames: str) -> dict[str, Any]:
    """Return what frames.json beside the frames tells of the run that rendered them; nothing where there is none."""
    path = _about(frames)
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({error}); remove it, or mend it") from None
    return told if isinstance(told, dict) else {}


def _fps_told(told: Mapping[str, Any]) -> float | None:
    fps = told.get("fps")
    return float(fps) if isinstance(fps, int | float) and 0 < fps < float("inf") else None


def _features(text: str | None) -> tuple[str, ...] | None:
    return None if text in (None, "auto") else tuple(name.strip() for name in text.split(","))
