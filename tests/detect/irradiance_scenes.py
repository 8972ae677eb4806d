"""Surfaces with known irradiance, for the tests of method irradiance."""

import numpy as np

from clsim.detect.config import DetectorConfig
from clsim.detector import Detector
from clsim.frames import ALBEDO, DEPTH, NORMAL, RADIANCE, Frame

SURFACE = (*RADIANCE, *ALBEDO, *NORMAL, *DEPTH)


def config_of(**options):
    return DetectorConfig(**{"method": "irradiance", "precision": "float64", **options})


def seen(frame, device=None, **options):
    """L and its standard error, ``[H, W]`` each, in the kernels' precision; NaN where the pixel is not valid."""
    detector = Detector(config_of(**options), frame.width, frame.height, frame.names, device=device)
    detector.step(frame)
    estimator = detector.estimator
    level = estimator.stages.place.read(estimator.levels.end)[:, : frame.width].astype(np.float64)
    detector.interest()
    error = estimator.stages.place.read(estimator.stages.error)[:, : frame.width].astype(np.float64)
    detector.close()
    return level, error


def surface(irradiance, albedo, normal=(0.0, 0.0, 1.0), depth=2.0, **planes):
    """A frame of surfaces whose grey ``albedo`` reflects ``irradiance``, each a number or ``[H, W]``.

    Further planes are added as they are; of a pixel with Coverage below 1, that share shows the surface.
    """
    albedo = np.asarray(albedo, dtype=np.float32).astype(np.float64)
    light = irradiance * albedo * planes.get("Coverage", 1.0) + planes.get("Emission", 0.0)
    values = [light] * 3 + [albedo] * 3 + list(normal) + [depth, *planes.values()]
    stack = np.stack(np.broadcast_arrays(*values)).astype(np.float32)
    return Frame(np.ascontiguousarray(stack), (*SURFACE, *planes))


def textured_room(seed, height=14, width=22):
    """Tilted surfaces with random texture, sky, lamps, dark spots, and pixels without samples; nothing is smooth."""
    rng = np.random.default_rng(seed)
    shape = (height, width)
    coverage = np.where(rng.random(shape) < 0.1, 0.0, rng.choice([0.25, 1.0], shape))
    normal = 0.3 * rng.standard_normal((3, *shape)) + np.array([0.0, 0.0, 1.0])[:, None, None]
    albedo = np.where(rng.random(shape) < 0.1, 5e-4, rng.uniform(0.05, 0.9, shape))
    depth = 2.0 + 0.05 * np.arange(width) + 0.05 * rng.standard_normal(shape)
    return surface(
        rng.lognormal(0.0, 0.7, shape),
        np.where(coverage > 0, albedo, 0.0),
        np.where(coverage > 0, normal, 0.0),
        np.where(coverage > 0, depth, 0.0),
        Coverage=coverage,
        Emission=np.where((rng.random(shape) < 0.1) | (coverage == 0), rng.uniform(0.5, 9.0, shape), 0.0),
        Samples=rng.integers(0, 5, shape),
    )


def shadowed_wall(seed, samples, height=30, width=41, slant=0.75):
    """A textured wall half in shadow, and what falls on it, ``[H, W]``: exponential noise, ``samples`` of it averaged.

    No depth and no normal shows the edge; with ``slant`` 0 it is upright, and with ``samples`` None there is no noise.
    """
    rng = np.random.default_rng(seed)
    fine = 8
    x, y = np.meshgrid(np.arange(fine * width) / fine, np.arange(fine * height) / fine)
    light = np.where(x + slant * (y - height / 2) < width / 2, 1.0, 0.2)
    light = light.reshape(height, fine, width, fine).mean(axis=(1, 3))
    noise = 1.0 if samples is None else rng.gamma(samples, 1.0 / samples, light.shape)
    return surface(light * noise, rng.uniform(0.05, 0.9, light.shape)), light


def spoiled(frame, seed, share=0.05):
    """Make some pixels NaN or infinite, each in one plane; return which."""
    rng = np.random.default_rng(seed)
    bad = rng.random((frame.height, frame.width)) < share
    ys, xs = np.nonzero(bad)
    planes = [i for i, name in enumerate(frame.names) if name != "Samples"]
    frame.planes[rng.choice(planes, len(ys)), ys, xs] = rng.choice([np.nan, np.inf, -np.inf], len(ys))
    return bad
