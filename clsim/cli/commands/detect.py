"""``clsim detect``: recorded frames become events."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from clsim.cli.options import parse
from clsim.cli.options.config import config_detector, read_config, suited
from clsim.cli.options.detector import (
    BANDWIDTH,
    BANDWIDTH_H,
    BOX,
    FEATURES,
    FLOOR,
    FPS,
    FRAMES,
    GATE,
    GATE_SCALE,
    KERNEL,
    LIKE,
    LUMINANCE,
    LUX_PER_UNIT,
    OUT,
    PRECISION,
    RECORDED_SENSOR,
    REGRESS,
    RESPONSE,
    RIDGE,
    SCALE,
    SENSOR_SEED,
    SHRINK,
    STRIDE,
    THRESHOLD,
    TIME_UNIT,
    TIMES,
    TRANSFER,
)
from clsim.cli.options.shared import (
    CONFIDENCE,
    CONFIG,
    EVENT_RULE,
    FORMAT,
    HISTORY,
    JSON,
    LABELS,
    METHOD,
    OPENCL,
    ROS_EVENTS,
    TEXT_TIME,
    WINDOW,
)
from clsim.detect.config import DetectorConfig
from clsim.errors import InputError

if TYPE_CHECKING:
    from clsim.live.sensors import RecordedSensor
    from clsim.live.session import Session


def detect(
    frames: FRAMES = None,
    out: OUT = None,
    fps: FPS = None,
    threshold: THRESHOLD = None,
    sensor: RECORDED_SENSOR = None,
    seed: SENSOR_SEED = None,
    lux_per_unit: LUX_PER_UNIT = None,
    transfer: TRANSFER = None,
    times: TIMES = None,
    time_unit: TIME_UNIT = None,
    like: LIKE = None,
    config: CONFIG = None,
    as_json: JSON = False,
    method: METHOD = None,
    gate: GATE = None,
    gate_scale: GATE_SCALE = None,
    box: BOX = None,
    event_rule: EVENT_RULE = None,
    window: WINDOW = None,
    stride: STRIDE = None,
    history: HISTORY = None,
    confidence: CONFIDENCE = None,
    kernel: KERNEL = None,
    bandwidth: BANDWIDTH = None,
    bandwidth_h: BANDWIDTH_H = None,
    ridge: RIDGE = None,
    regress: REGRESS = None,
    shrink: SHRINK = None,
    response: RESPONSE = None,
    luminance: LUMINANCE = None,
    scale: SCALE = None,
    floor: FLOOR = None,
    features: FEATURES = None,
    precision: PRECISION = None,
    opencl: OPENCL = None,
    format: FORMAT = None,
    text_time: TEXT_TIME = None,
    labels: LABELS = None,
    ros_events: ROS_EVENTS = None,
) -> int:
    """Turn EXR frames, video or pictures into events.

    Frames of `clsim render` tell in their frames.json which detector they were rendered for: that one is taken, as
    far as no option says otherwise, and the events are those of `clsim live`. Other EXR frames get esim-ad, video and
    pictures esim.

    Examples: `clsim detect frames --fps 60 --out events.aedat4`, `clsim detect clip.mp4 --out events.aedat4`
    """
    given = dict(locals())
    from clsim.cli.output.status import run_session
    from clsim.events.sockets.address import is_standard_output

    if frames is None and config is None:
        raise InputError("which frames? Name a video or a folder of pictures, or a --config")
    if not out:
        raise InputError("where shall the events go? Give --out a file or an address")
    if as_json and any(map(is_standard_output, out)):
        raise InputError("--json and --out - would both write to standard output; give --out a file instead")
    return run_session(_open(given) if config is None else _repeat(config, given), as_json=as_json)


_FOR_THE_SENSOR = ("sensor", "seed", "lux_per_unit")
_FOR_PICTURES = ("times", "time_unit", "transfer", "like")
_FOR_FILES = ("out", "format", "text_time", "ros_events", "labels", "as_json")
_NOT_FOR_THE_DETECTOR = (
    "frames",
    "config",
    "fps",
    "threshold",
    "opencl",
    *_FOR_THE_SENSOR,
    *_FOR_PICTURES,
    *_FOR_FILES,
)


def _open(given: Mapping[str, Any]) -> Session:
    """Return the session of what was ``given`` to `detect`."""
    from clsim.events.outputs import FileOptions
    from clsim.footage.open import is_footage
    from clsim.live.footage import FootageOptions, open_footage_session
    from clsim.live.recording_options import RecordingOptions
    from clsim.live.sensors import RecordedSensor
    from clsim.live.session import open_recording

    frames, fps, opencl, out = given["frames"], given["fps"], given["opencl"], tuple(given["out"])
    chosen = {name: value for name, value in given.items() if name not in _NOT_FOR_THE_DETECTOR}
    chosen["features"] = _features(given["features"])
    if given["threshold"] is not None:
        chosen["threshold_on"], chosen["threshold_off"] = parse.threshold(given["threshold"])
    files = FileOptions(given["format"], given["text_time"], given["ros_events"], labels=bool(given["labels"]))
    eye = _given({name: given[name] for name in _FOR_THE_SENSOR})
    pictures = _given({name: given[name] for name in _FOR_PICTURES})
    if "time_unit" in pictures and "times" not in pictures:
        raise InputError("`time_unit` is that of the file in `times`, which is not given")
    if is_footage(frames):
        footage = FootageOptions(
            frames, fps, **pictures, opencl=opencl, outputs=out, files=files, seen_by=RecordedSensor(**eye)
        )
        return open_footage_session(footage, _given(chosen))
    if pictures:
        raise InputError(f"`{next(iter(pictures))}` is for video and pictures; EXR frames hold linear light")
    told = _told_by(frames)
    seen_by = _seen_by(frames, told, eye)
    config = detector_config(frames, told, chosen, seen_by)
    return open_recording(RecordingOptions(frames, config, fps, opencl, out, files, _fps_told(told), seen_by))


def _repeat(config: Path, given: Mapping[str, Any]) -> Session:
    """Return the session of a sidecar's options; what is ``given`` to `detect` wins."""
    from clsim.events.outputs import FileOptions
    from clsim.footage.conventions import CONVENTIONAL
    from clsim.live.footage import FootageOptions, open_footage_session
    from clsim.live.recording_options import RecordingOptions
    from clsim.live.session import open_recording
    from clsim.values import from_plain

    told = read_config(config)
    if "frames" not in told:
        raise InputError(f"--config {config}: is of no run of clsim detect; expected the .json beside what one wrote")
    chosen = _given({name: value for name, value in given.items() if name not in _NOT_FOR_THE_DETECTOR})
    if given["features"] is not None:
        chosen["features"] = _features(given["features"])
    if given["threshold"] is not None:
        chosen["threshold_on"], chosen["threshold_off"] = parse.threshold(given["threshold"])
    run = _given({name: given[name] for name in ("frames", "fps", "opencl", *_FOR_PICTURES)})
    out = tuple(given["out"])
    how = suited(told.get("files"), out)
    how |= _given({name: given[name] for name in ("format", "text_time", "ros_events", "labels")})
    run |= {"outputs": out, "files": FileOptions(**how)}
    eye = _given({name: given[name] for name in _FOR_THE_SENSOR})
    plain = {name: value for name, value in told.items() if name not in ("outputs", "files")}
    try:
        if "config" in plain:
            recording = RecordingOptions.from_dict(plain)
            seen_by = replace(recording.seen_by, **eye)
            detector = replace(recording.config, **chosen)
            return open_recording(replace(recording, **run, config=detector, seen_by=seen_by))
        found = plain.pop("detector", None) or config_detector(config)
        if not isinstance(found, dict):
            raise InputError(f"--config {config}: detector must be options by name, got {found!r}")
        if given["like"] is not None:  # whose settings the others are
            found = {name: value for name, value in found.items() if name not in CONVENTIONAL}
            plain.pop("transfer", None)
        for one, other in (("fps", "times"), ("times", "fps")):  # two ways to say one thing
            plain = {name: value for name, value in plain.items() if one not in run or name != other}
        footage = from_plain(FootageOptions, plain)
        return open_footage_session(replace(footage, **run, seen_by=replace(footage.seen_by, **eye)), found | chosen)
    except TypeError as error:
        raise InputError(f"--config {config}: {error}") from None


def detector_config(
    frames: str, told: Mapping[str, Any], given: Mapping[str, Any], seen_by: RecordedSensor | None = None
) -> DetectorConfig:
    """Return the detector's options: those ``given`` (None: not given), the sensor's, else those ``told``."""
    from clsim.values import from_plain

    chosen = _given(given)
    detector = told.get("detector")
    try:
        base = from_plain(DetectorConfig, detector if isinstance(detector, dict) else {})
    except InputError as error:
        raise InputError(f"{_about(frames)}: {error}") from None
    if seen_by is not None:
        chosen = seen_by.detector(chosen, chosen.get("method", base.method))
    if chosen.get("method", base.method) != base.method:
        base = replace(base, window=None)
    filtered = seen_by is not None and seen_by.sensor is not None and not seen_by.sensor.is_ideal
    if base.event_rule == "linear-light" and (filtered or chosen.get("response", base.response) != "ln"):
        base = replace(base, event_rule="interpolated")
    return replace(base, **chosen)


def _seen_by(frames: str, told: Mapping[str, Any], given: Mapping[str, Any]) -> RecordedSensor:
    """Return the sensor: what is ``given`` of it, and of the rest what frames.json ``told``."""
    from clsim.live.sensors import RecordedSensor
    from clsim.values import from_plain

    seen_by = told.get("seen_by")
    try:
        base = from_plain(RecordedSensor, seen_by if isinstance(seen_by, dict) else {})
    except InputError as error:
        raise InputError(f"{_about(frames)}: {error}") from None
    return replace(base, **given)


def _given(options: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in options.items() if value is not None}


def _about(frames: str) -> Path:
    return (Path(frames) if Path(frames).is_dir() else Path(frames).parent) / "frames.json"


def _told_by(frames: str) -> dict[str, Any]:
    """Return what frames.json beside the frames tells of the run that rendered them; nothing where there is none."""
    path = _about(frames)
    try:
        told = json.loads(path.read_text(encoding="utf-8-sig"))
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
