"""Measure Mitsuba's sky and sun, and fit the model of clear skies to them: writes clsim/scene/light/daylight.npz.

python -m tools.accuracy.fit_sky clsim/scene/light/daylight.npz

Needs mitsuba with LLVM, and scipy. The model is that of Hosek and Wilkie, "An Analytic Model for Full Spectral Sky-Dome
Radiance", SIGGRAPH 2012, eq. 8 and 9; its parameters are found here for each of some turbidities, reflectances of the
ground and heights of the sun, from what Mitsuba's plugin ``sunsky`` returns there.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import mitsuba
import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from clsim.scene.light.daylight import ALBEDOS, HEIGHTS, TURBIDITIES, dome
from tools.peers.mitsuba_variant import load_mitsuba

F64 = npt.NDArray[np.float64]
START = np.array([-1.0, -0.3, 0.5, 1.0, -3.0, 0.3, 0.05, 0.6, 0.5])
SCALED = [2, 3, 5, 6, 8]
"""Parameters that grow as the radiance does."""
SUN_RAD = math.radians(0.5358) / 2


def measured(scene: dict[str, Any], directions: F64) -> F64:
    """Return what comes from directions ``[n, 3]``, +z up, as ``[n, 3]``."""
    emitter = mitsuba.load_dict({"type": "sunsky", **scene})
    at = mitsuba.SurfaceInteraction3f()
    at.wi = -mitsuba.Vector3f(*directions.T.copy())
    return np.array(emitter.eval(at)).reshape(3, -1).T.astype(np.float64)


def sun_of(height: float) -> F64:
    """Return the direction to the sun for a place in the table."""
    angle = 0.5 * math.pi * height**3
    return np.array([0.0, math.cos(angle), math.sin(angle)])


def on_dome(count: int) -> F64:
    """Return directions spread evenly over the upper half (Fibonacci's spiral)."""
    k = np.arange(count) + 0.5
    z, phi = k / count, k * math.pi * (3.0 - math.sqrt(5.0))
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(phi), radius * np.sin(phi), z], axis=1)


def on_disk(to_sun: F64) -> F64:
    """Return directions spread evenly over the sun's disk."""
    rng = np.random.default_rng(0)
    away, turn = np.tan(SUN_RAD * np.sqrt(rng.random(256))), 2 * math.pi * rng.random(256)
    up = np.array([0.0, -to_sun[2], to_sun[1]])
    disk = to_sun + np.outer(away * np.cos(turn), [1.0, 0.0, 0.0]) + np.outer(away * np.sin(turn), up)
    return np.asarray(disk / np.linalg.norm(disk, axis=1, keepdims=True))


def fit(values: F64, cosine: F64, gamma: F64, near: list[F64]) -> F64:
    """Return the nine parameters that fit radiance best, as a share of it; ``near`` are those of skies like it."""
    scale = values.mean()
    starts = [START, *(np.where(np.isin(np.arange(9), SCALED), each / scale, each) for each in near)]
    weights = 1.0 / (values / scale + 0.05)

    def off(p: F64) -> F64:
        return (dome(p, cosine, gamma) - values / scale) * weights

    found = [least_squares(off, each, method="trf", x_scale="jac", max_nfev=400) for each in starts]
    best = min(found, key=lambda each: each.cost)
    print(f"  rms {math.sqrt(2 * best.cost / len(values)):.4f}", flush=True)
    p = best.x.copy()
    p[SCALED] *= scale
    return p


def main() -> None:
    """Write the table."""
    load_mitsuba()
    directions = on_dome(800)
    shape = len(TURBIDITIES), len(HEIGHTS)
    sky = np.zeros((*shape, len(ALBEDOS), 3, 9))
    sun = np.zeros((*shape, 3))
    for i, turbidity in enumerate(TURBIDITIES):
        for j, height in enumerate(HEIGHTS):
            to_sun = sun_of(height)
            angle = max(math.atan2(to_sun[2], to_sun[1]), 1e-4)
            scene = {"turbidity": float(turbidity), "sun_direction": [0.0, math.cos(angle), math.sin(angle)]}
            disk = on_disk(to_sun)
            sun[i, j] = measured(scene | {"sky_scale": 0.0}, disk[disk[:, 2] > 0]).mean(axis=0)
            cosine, gamma = directions[:, 2], np.arccos(np.clip(directions @ to_sun, -1, 1))
            for k, albedo in enumerate(ALBEDOS):
                values = measured(scene | {"sun_scale": 0.0, "albedo": float(albedo)}, directions)
                for c in range(3):
                    near = [sky[i, j - 1, k, c]] * (j > 0) + [sky[i, j, k - 1, c]] * (k > 0)
                    print(turbidity, height, albedo, c, end="")
                    sky[i, j, k, c] = fit(values[:, c], cosine, gamma, near)
    np.savez_compressed(Path(sys.argv[1]), sky=sky.astype(np.float32), sun=sun.astype(np.float32))


if __name__ == "__main__":
    main()
