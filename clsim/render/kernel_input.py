"""The arguments that all tracing kernels share."""

import itertools
import math
from typing import Any, Literal

import warp as wp

from clsim.render.accel.geometry import Geometry
from clsim.render.emitters.lights import Lights
from clsim.render.options import RenderOptions
from clsim.render.surfaces.materials import Materials
from clsim.scene import Camera
from clsim.scene.light.spectral import seen_by_pixels, spectral_weights
from clsim.scene.world import Sensor

Mosaic = wp.types.matrix(shape=(4, 3), dtype=float)
"""What the pixels (0, 0), (1, 0), (0, 1) and (1, 1) of each square see of R, G and B, a row each."""

SOBOL_BATCHES = 4
"""Independently scrambled batches of Sobol points; more make variances surer and pictures noisier."""


@wp.struct
class Settings:
    """The options of a render that change nothing in the code; ``stream`` is the hash of seed (and frame).

    The exposure begins at ``opens`` and takes ``lasts`` of the interval that the scene's data covers. ``spectral`` is
    what pixels see of R, G and B, and ``mosaic`` what those of each square of four do. Nothing is farther away than
    ``reach_m``, if that is finite, and no sphere is less wide than ``least_sphere_rad`` [rad], seen from the camera.
    ``specks`` are what is so small that it may hide between a pixel's corners, see `SceneData.specks`.
    Pixels see no difference in luminance below ``darkest``.
    """

    samples: int
    batches: int
    max_depth: int
    roulette_start: int
    width: int
    height: int
    opens: float
    lasts: float
    spectral: wp.vec3
    mosaic: Mosaic
    reach_m: float
    least_sphere_rad: float
    specks: wp.array[wp.vec4, Literal[2]]
    darkest: float
    stream: wp.uint64


@wp.func
def spectral_of(settings: Settings, pixel: int) -> wp.vec3:
    """Return what a pixel sees of R, G and B."""
    line = pixel // settings.width
    return settings.mosaic[2 * (line % 2) + (pixel - line * settings.width) % 2]


@wp.struct
class Scene:
    """All that a ray may meet."""

    geometry: Geometry
    materials: Materials
    lights: Lights


def settings_of(options: RenderOptions, camera: Camera, sensor: Sensor) -> Any:
    """Return the kernel's settings for pictures of a camera with such pixels."""
    settings: Any = Settings()
    settings.samples = options.spp
    settings.batches = SOBOL_BATCHES
    settings.max_depth = options.max_depth
    settings.roulette_start = options.roulette_start
    settings.width, settings.height = camera.width, camera.height
    settings.reach_m = math.inf
    settings.darkest = sensor.floor / sensor.scale
    settings.spectral = wp.vec3(*spectral_weights(sensor.spectral))
    settings.mosaic = Mosaic(*itertools.chain.from_iterable(seen_by_pixels(sensor)))
    return settings
