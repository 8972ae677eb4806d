"""Light that changes, and light of the day, from a scene's TOML."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from clsim.scene.files import named_file
from clsim.scene.modulation import Keyframed, Modulation, Pwm, Sine
from clsim.scene.pictures.film import Files, Film, Video, is_video
from clsim.scene.pictures.images import PixelBudget
from clsim.scene.world import EnvironmentMap, Instance, Mesh, SphereLight, Vec3

if TYPE_CHECKING:
    from clsim.scene.toml import schema_light as schema
    from clsim.scene.toml.schema import ImageTable


def read_modulation(table: schema.SineTable | schema.PwmTable | schema.LightKeyframesTable | None) -> Modulation | None:
    """Return how a light changes with time; None where it does not."""
    if table is None:
        return None
    if table.kind == "sine":
        return Sine(table.frequency_hz, table.depth, table.phase_deg)
    if table.kind == "pwm":
        return Pwm(table.frequency_hz, table.duty, table.low, table.phase_deg)
    factors = tuple(
        key.factor if isinstance(key.factor, tuple) else (key.factor, key.factor, key.factor) for key in table.keyframes
    )
    times_s = tuple(key.time_s for key in table.keyframes)
    return Keyframed(times_s, factors, table.interpolation == "step", table.repeat)


def read_film(table: ImageTable, folder: Path, budget: PixelBudget) -> Film | None:
    """Return the film that a texture is; None where it is a picture.

    Raises:
        InputError: its files cannot be used.
    """
    if table.frames is not None:
        return Film(Files(table.frames, folder, budget), table.fps or 1.0, loop=table.loop)
    if table.file is None or not is_video(table.file):
        return None
    video = Video(named_file(table.file, folder), budget)
    return Film(video, table.fps or video.fps, loop=table.loop)


def read_daylight(
    table: schema.DaylightTable, path: Path, meshes: Sequence[Mesh], instances: Sequence[Instance]
) -> tuple[EnvironmentMap | None, list[SphereLight]]:
    """Return the sky and the sun, as far as they shine: not at night.

    Raises:
        InputError: what they light has no extent; it names the file.
    """
    from clsim.scene.defaults.framing import bounds
    from clsim.scene.light.daylight import Daylight, sky, sun_light

    day = Daylight(_to_sun(table), table.turbidity, table.ground)
    if day.is_night:
        return None, []
    upright = np.eye(3)
    above = EnvironmentMap(sky(day) * np.float32(table.sky_scale), upright) if table.sky_scale > 0 else None
    if table.sun_scale == 0:
        return above, []
    middle, size = bounds(path, meshes, instances) if instances else ((0.0, 0.0, 0.0), np.ones(3))
    return above, [sun_light(day, upright, middle, float(np.linalg.norm(size)) / 2, table.sun_scale)]


def _to_sun(table: schema.DaylightTable) -> Vec3:
    from clsim.scene.light.daylight import sun_at

    if table.elevation_deg is not None:
        height, turn = math.radians(table.elevation_deg), math.radians(table.azimuth_deg)
        return math.cos(height) * math.sin(turn), math.sin(height), -math.cos(height) * math.cos(turn)
    if table.latitude_deg is None or table.time is None:
        raise ValueError("expected a place and a time, which the schema asks for")
    return sun_at(table.latitude_deg, table.longitude_deg, table.time)
