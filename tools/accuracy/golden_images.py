"""Render the golden images that tests/render/test_golden.py compares with.

python tools/accuracy/golden_images.py tests/render/golden

Make them anew only when the picture is meant to change, and say why in the commit. They are block means of clean
renders, so that another sequence of random numbers passes and a wrong picture does not.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import numpy.typing as npt

from clsim.frames import Frame, page_aligned, rendered_planes
from clsim.render import PathTracer, RenderOptions
from clsim.scene import bundled_scenes, load_world

WIDTH, HEIGHT, BLOCK = 64, 48, 8
INDEX = 30
GOLDEN_SPP = 4096
CHANNELS = tuple(
    channel for plane in rendered_planes().planes if plane.reduction != "sum" for channel in plane.channels
)
"""What is compared: not the number of samples."""


def block_means(scene: str, spp: int, seed: int = 0) -> npt.NDArray[np.float32]:
    """Render frame INDEX of a scene and return its block means ``[planes, HEIGHT / BLOCK, WIDTH / BLOCK]``."""
    world = load_world(scene, resolution=(WIDTH, HEIGHT))
    # Variances change nothing in the other planes, and other tests have kernels with them.
    tracer = PathTracer(world, RenderOptions(spp=spp, seed=seed, variances=True))
    frame = Frame(page_aligned((len(tracer.names), HEIGHT, WIDTH)), tracer.names)
    tracer.fill(INDEX, frame)
    tracer.close()
    planes = np.stack([frame.plane(name) for name in CHANNELS])
    blocks = planes.reshape(len(CHANNELS), HEIGHT // BLOCK, BLOCK, WIDTH // BLOCK, BLOCK)
    means: npt.NDArray[np.float32] = blocks.mean(axis=(2, 4), dtype=np.float64).astype(np.float32)
    return means


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    for name in bundled_scenes():
        np.save(folder / f"{name}.npy", block_means(name, GOLDEN_SPP, seed=12345))
