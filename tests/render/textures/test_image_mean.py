# Warp: a variable that changes must be born by a call.
# ruff: noqa: UP018
"""The mean of an image over a pixel: the bits of a sum over single places."""

from __future__ import annotations

import itertools

import numpy as np
import warp as wp

from clsim.render.textures.texture_data import CLAMP, MIRROR, REPEAT, Footprint, TextureRow, Textures, uv_in
from clsim.render.textures.textures import image, image_mean

PLACES = 45


@wp.kernel(enable_backward=False)
def means(textures: Textures, footprints: wp.array(dtype=Footprint), places: int, out: wp.array2d(dtype=wp.vec4)):
    """Write the mean of the texture of each number over a pixel, and the same place by place."""
    i, number = wp.tid()
    row = textures.rows[number]
    out[2 * number, i] = image_mean(textures, row, footprints[i], places, wp.vec3())
    total = wp.vec4()
    y = float(0.5)
    for k in range(places):
        uv = uv_in(footprints[i], (float(k) + 0.5) / float(places), y)
        total += image(textures, row, uv) / float(places)
        y = y + 0.6180339887
        y = y - wp.floor(y)
    out[2 * number + 1, i] = total


def test_the_mean_of_an_image_has_the_bits_of_its_places():
    """Whatever the wrapping, in perspective, near and far, and also of images one texel wide."""
    random = np.random.default_rng(0)
    wraps = list(itertools.product((REPEAT, CLAMP, MIRROR), repeat=2))
    sizes = [(1, 1), (7, 5), (64, 128)]
    rows = np.zeros(len(wraps) * len(sizes), TextureRow.numpy_dtype())
    first = 10
    for row, ((wrap_u, wrap_v), (width, height)) in zip(rows, itertools.product(wraps, sizes), strict=True):
        row["first"], row["width"], row["height"], row["decoding"] = first, width, height, 256
        row["wrap_u"], row["wrap_v"] = wrap_u, wrap_v
        row["uv_matrix"] = np.eye(2, 3) + random.normal(size=(2, 3)) * 0.3
        first += width * height
    textures = Textures()
    textures.rows = wp.array(rows, dtype=TextureRow, device="cpu")
    textures.texels = wp.array(random.integers(0, 1 << 32, first, dtype=np.uint32), dtype=wp.uint32, device="cpu")
    textures.decoding = wp.array(random.uniform(size=512).astype(np.float32), dtype=float, device="cpu")

    count = 100
    pixels = np.zeros(count, Footprint.numpy_dtype())
    middle, size = random.uniform(-2, 2, (count, 2)), random.choice([1e-3, 0.1, 3.0], (count, 1))
    for name in pixels.dtype.names:
        nearness = random.uniform(0.5, 1.5, (count, 1))
        uv = middle + size * random.uniform(-1, 1, (count, 2))
        pixels[name] = np.concatenate([uv * nearness, nearness], axis=1)
    found = wp.zeros((2 * len(rows), count), dtype=wp.vec4, device="cpu")
    inputs = [textures, wp.array(pixels, dtype=Footprint, device="cpu"), PLACES]
    wp.launch(means, dim=(count, len(rows)), inputs=inputs, outputs=[found], device="cpu")
    together, one_by_one = found.numpy().reshape(len(rows), 2, count, 4).swapaxes(0, 1)
    assert np.unique(one_by_one[:, :, 0]).size > 1000
    np.testing.assert_array_equal(together.view(np.uint32), one_by_one.view(np.uint32))
