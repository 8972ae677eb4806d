"""``--config``: the options of a run from a file, in TOML or JSON, such as the sidecar of what an earlier run wrote."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from clsim.cli.options import parse
from clsim.datasets.toml import read_toml
from clsim.errors import InputError
from clsim.values import read_value

if TYPE_CHECKING:
    from clsim.live.options import LiveOptions

_FILES = ("scene", "camera_path", "sensor", "imu_noise", "times")
"""Options that may name a file."""
_LENGTHS = ("duration_s", "frame_count")
"""Two ways to say one thing: who gives one means it instead of the other."""


def read_config(path: Path) -> dict[str, Any]:
    """Return the options in a file: TOML, or a JSON object of them, or with them under ``options``, as in a sidecar."""
    try:
        found = read_toml(path) if path.suffix == ".toml" else json.loads(path.read_text(encoding="utf-8-sig"))
    except InputError as error:
        raise InputError(f"--config {error}") from None
    except OSError as error:
        raise InputError(f"--config {path}: cannot be read ({error.strerror})") from None
    except ValueError as error:
        raise InputError(f"--config {path}: is no JSON ({error}); TOML ends in .toml") from None
    options = found.get("options", found) if isinstance(found, dict) else None
    if not isinstance(options, dict):
        raise InputError(f"--config {path}: holds no options; expected a JSON object, such as a sidecar")
    scene, moved = options.get("scene"), found.get("scene_from_here")
    if isinstance(scene, str) and isinstance(moved, str) and not _is_scene_file(scene):
        beside = str(path.resolve().parent / moved)  # the sidecar and its scene may have moved together
        return options | {"scene": beside if _is_scene_file(beside) else scene}
    return dict(options) | {name: _beside(path, options[name]) for name in _FILES if name in options}


def _beside(config: Path, name: Any) -> Any:
    """Return a file's name; if there is none from here, but one from the folder of the file that tells it, that one."""
    if not isinstance(name, str) or not name:
        return name
    file, mark, part = name.partition("#")
    there = config.parent / file
    return f"{there}{mark}{part}" if there.exists() and not Path(file).exists() and Path(file).suffix else name


def config_detector(path: Path) -> Any:
    """Return the options of detection that stand beside those of a run, as in a sidecar; none in TOML."""
    return {} if path.suffix == ".toml" else json.loads(path.read_text(encoding="utf-8-sig")).get("detector", {})


def config_times_us(path: Path) -> list[int] | None:
    """Return the times of frames [µs] that a file tells, as the sidecar of frames at chosen times does; else None."""
    from clsim.footage.times import check_rising

    found = {} if path.suffix == ".toml" else json.loads(path.read_text(encoding="utf-8-sig"))  # `read_config` read it
    if "times_us" not in found:
        return None
    times_us = read_value("times_us", found["times_us"], tuple[int, ...])
    if not times_us:
        raise InputError(f"--config {path}: `times_us` holds no times")
    check_rising(list(times_us), f"--config {path}")
    return list(times_us)


def _is_scene_file(scene: str) -> bool:
    return Path(scene).is_file() or Path(scene.rpartition("#")[0]).is_file()


def live_options(parameters: Mapping[str, Any]) -> LiveOptions:
    """Return the options of a run: those given on the command line, else those of a file.

    Args:
        parameters: a command's, by name: the fields of ``LiveOptions`` and ``FileOptions``, with ``duration``,
            ``time_tolerance``, ``resolution``, ``threshold`` and ``truth`` as text, and ``config``, the file. None is
            not given.

    Where events go is never repeated: what is there already shall stay. Of how ``files`` are written, their time and
    frames are, where they suit the new outputs; the format is told by their names.
    """
    from clsim.events.outputs import FileOptions
    from clsim.live.options import LiveOptions
    from clsim.live.quality import setting_names
    from clsim.live.settings import SceneSettings

    chosen = {name: value for name, value in parameters.items() if value is not None}
    config: Path | None = chosen.pop("config", None)
    if "duration" in chosen:
        chosen["duration_s"] = parse.duration_s(chosen.pop("duration"))
    if "time_tolerance" in chosen:
        chosen["time_tolerance_us"] = 1e6 * parse.duration_s(chosen.pop("time_tolerance"), "--time-tolerance")
    readers = (("resolution", parse.resolution), ("threshold", parse.threshold), ("truth", parse.names))
    for name, read in readers:
        if name in chosen:
            chosen[name] = read(chosen[name])
    written = {name: chosen.pop(name) for name in FileOptions.__dataclass_fields__ if name in chosen}
    if config is None:
        return LiveOptions(**_with_scene(chosen), files=FileOptions(**written))
    base = {name: value for name, value in read_config(config).items() if name != "outputs"}
    how = suited(base.pop("files", {}), chosen.get("outputs", ()))
    if "quality" in chosen and "quality" in base:  # whose settings the others are
        base = {name: value for name, value in base.items() if name not in setting_names()}
    if chosen.get("truth") == ("none",):
        base.pop("frame_rate", None)  # it is that of truth
    if any(name in chosen for name in _LENGTHS):
        base = {name: value for name, value in base.items() if name not in _LENGTHS}
    try:
        run = LiveOptions.from_dict(_with_scene(base | chosen) | {"files": FileOptions(**(how | written))})
    except InputError as error:
        given = any(f"`{name}`" in str(error) for name in chosen)
        raise InputError(str(error) if given else f"--config {config}: {error}") from None
    other = "sensor" in chosen and run.ideal != SceneSettings(run.scene, sensor=base.get("sensor")).ideal
    if other and "event_rule" not in chosen and run.event_rule != "frame":
        return replace(run, event_rule=None)  # that was the quality's, which has another one for such a sensor
    return run


def _with_scene(options: dict[str, Any]) -> dict[str, Any]:
    if "scene" not in options and "frames" in options:
        raise InputError("it is of a run of clsim detect, which has no scene: use clsim detect --config")
    if "scene" not in options:
        raise InputError("which scene? Name a bundled one (see `clsim scenes`), a scene file, or a --config")
    return options


def suited(files: object, outputs: tuple[str, ...]) -> dict[str, Any]:
    """Return the settings of ``files`` that concern one of the outputs."""
    from clsim.events.outputs import FileOptions
    from clsim.values import from_plain

    told = from_plain(FileOptions, files if isinstance(files, dict) else {})
    suited: dict[str, Any] = {}
    for name in ("text_time", "ros_events", "frames", "labels"):
        alone = from_plain(FileOptions, {name: getattr(told, name)})
        with contextlib.suppress(InputError):
            alone.check(outputs)
            suited |= {name: value for name, value in vars(alone).items() if value}
    return suited
