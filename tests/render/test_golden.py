"""Bundled scenes look as they did: block means of 8×8 pixels against stored ones of 4096 paths a pixel.

Tolerances: radiance within 3 % of the block's mean plus .3 % of the picture's (about 5 standard errors at 512 paths);
normal, albedo and coverage within 1 % plus .02; depth within 8 %, for at a horizon it varies most.
"""

from pathlib import Path

import numpy as np
import pytest

from clsim.frames import DEPTH, RADIANCE
from clsim.scene import bundled_scenes
from tools.accuracy.golden_images import CHANNELS, block_means

GOLDEN = Path(__file__).parent / "golden"
FEW = ("edge", "uniform-wall")
"""Scenes with next to no noise: with an eighth of the paths errors are far smaller than what is allowed."""


@pytest.mark.usefixtures("anything")
@pytest.mark.parametrize(
    "scene",
    [pytest.param(each, marks=pytest.mark.slow if each == "cornell" else ()) for each in sorted(bundled_scenes())],
)
def test_a_bundled_scene_looks_as_it_did(scene: str) -> None:
    golden = np.load(GOLDEN / f"{scene}.npy")
    found = block_means(scene, spp=64 if scene in FEW else 512)
    for plane, name in enumerate(CHANNELS):
        if name in RADIANCE:
            allowed = 0.03 * golden[plane] + 0.003 * golden[plane].mean()
        elif name in DEPTH:
            allowed = 0.08 * golden[plane] + 0.01
        else:
            allowed = 0.01 * np.abs(golden[plane]) + 0.02
        error = np.abs(found[plane] - golden[plane])
        assert (error <= allowed).all(), f"{name}: {(error / allowed).max():.2f} of what is allowed"
