"""Coarser levels of images, and the mean over a pixel that reads them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from clsim.render import SceneData
from clsim.render.surfaces.texture_levels import add_levels, coarser
from clsim.render.surfaces.upload_materials import decoding
from clsim.render.textures.texture_data import Footprint, TextureRow, Textures
from clsim.scene import ImageTexture, Material
from tests.render import hand_worlds as hw
from tests.render.textures.test_image_mean import means

SRGB = decoding()[256:]


@pytest.mark.parametrize(("height", "width"), [(64, 32), (37, 51), (5, 8)])
def test_each_level_has_the_mean_of_the_image(height, width):
    """Of linear light, and of any size: each texel of a level counts as much as any other."""
    pixels = np.random.default_rng(1).integers(0, 256, (height, width, 4), dtype=np.uint8)
    levels = coarser(pixels, srgb=True)
    assert len(levels) == int(np.log2(min(height, width)))
    truth = SRGB[pixels[..., :3]].mean(axis=(0, 1))
    for number, level in enumerate(levels, 1):
        shape = height >> number, width >> number, 4
        found = SRGB[level.view(np.uint8).reshape(shape)[..., :3]].mean(axis=(0, 1))
        # A byte is half a step off at most: 1/200 in linear light, less where there are many.
        np.testing.assert_allclose(found, truth, atol=0.005 / np.sqrt(np.prod(shape[:2])) + 5e-4)


@pytest.mark.parametrize("upright", [False, True])
def test_a_level_lies_where_the_image_does(upright):
    """A ramp stays one: rows and columns that are no power of two are neither shifted nor left out."""
    height, width = 45, 83
    ramp = np.linspace(0.1, 0.9, width) * np.ones((height, 1))
    pixels = np.repeat(np.round(ramp * 255).astype(np.uint8)[..., None], 4, axis=2)
    levels = coarser(pixels.swapaxes(0, 1).copy() if upright else pixels, srgb=False)
    for number, level in enumerate(levels, 1):
        columns, rows = width >> number, height >> number
        shape = (columns, rows) if upright else (rows, columns)
        texels = level.view(np.uint8).reshape(*shape, 4)[..., 0] / 255
        row = texels[:, 0] if upright else texels[0]
        places = (np.arange(columns) + 0.5) / columns * width - 0.5
        # To a twentieth of a texel, and a byte's steps.
        np.testing.assert_allclose(row, 0.1 + 0.8 * places / (width - 1), atol=0.05 * 0.8 / columns + 0.004)


def test_levels_mean_what_their_texture_says_of_the_bytes():
    """One image as sRGB and as plain numbers; one of which no mean is taken has none, nor one that changes."""
    pixels = np.full((2, 2, 4), 255, np.uint8)
    pixels[0] = 0
    materials = [Material(texture=0), Material(texture=1, normal_texture=2)]
    world = hw.world(*(hw.quad((0, 0, -i), (1, 0, 0), (0, 1, 0), i) for i in range(2)), materials=materials)
    textures = [ImageTexture(pixels, srgb=True), ImageTexture(pixels, srgb=False), ImageTexture(pixels.copy(), False)]
    data = SceneData(replace(world, textures=tuple(textures)))
    data.add_texture_levels()
    found = data.scene.materials.textures
    rows, coarse = found.rows.numpy(), found.coarse.numpy()
    assert rows["levels"].tolist() == [1, 1, 0]
    values = decoding()[rows["decoding"][:2] + (coarse[rows["coarse"][:2]] & 255)]
    np.testing.assert_allclose(values, 0.5, atol=0.005)
    changing = replace(textures[0], film=object()), replace(textures[1], nearest=True)
    data = SceneData(replace(world, textures=tuple(textures)))
    add_levels(replace(world, textures=(*changing, textures[2])), data.scene.materials.textures)
    assert not data.scene.materials.textures.rows.numpy()["levels"].any()


def test_the_mean_over_a_pixel_is_right_from_few_places_of_coarse_levels():
    """A pixel that shows many texels, against all of them: as few places of the image itself miss most."""
    random = np.random.default_rng(2)
    size = 256
    pixels = random.integers(0, 256, (size, size, 4), dtype=np.uint8)
    pixels[..., 3] = 255
    rows = np.zeros(2, TextureRow.numpy_dtype())
    rows["width"], rows["height"], rows["decoding"], rows["uv_matrix"] = size, size, 256, np.eye(2, 3)
    levels = coarser(pixels, srgb=True)
    rows["levels"][1] = len(levels)
    textures = Textures()
    textures.rows = wp.array(rows, dtype=TextureRow, device="cpu")
    textures.texels = wp.array(pixels.view("<u4").ravel(), dtype=wp.uint32, device="cpu")
    textures.coarse = wp.array(np.concatenate(levels), dtype=wp.uint32, device="cpu")
    textures.decoding = wp.array(decoding().astype(np.float32), dtype=float, device="cpu")

    count, texels = 200, 48
    footprints = np.zeros(count, Footprint.numpy_dtype())
    first = random.integers(0, size - texels, (count, 2))
    for name, right, down in (
        ("top_left", 0, 0), ("top_right", 1, 0), ("bottom_left", 0, 1), ("bottom_right", 1, 1)
    ):  # fmt: skip
        u = (first[:, 0] + right * texels) / size
        v = 1 - (first[:, 1] + down * texels) / size
        footprints[name] = np.stack([u, v, np.ones(count)], axis=1)
    linear = SRGB[pixels[..., :3]]
    truth = np.array([linear[y : y + texels, x : x + texels].mean(axis=(0, 1)) for x, y in first])
    found = wp.zeros((4, count), dtype=wp.vec4, device="cpu")
    inputs = [textures, wp.array(footprints, dtype=Footprint, device="cpu"), 45]
    wp.launch(means, dim=(count, 2), inputs=inputs, outputs=[found], device="cpu")
    plain, coarse = found.numpy()[[0, 2], :, :3]
    errors = [np.sqrt(((each - truth) ** 2).mean()) for each in (plain, coarse)]
    assert errors[0] > 0.02 and errors[1] < 0.3 * errors[0], errors
