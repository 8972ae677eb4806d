"""Texture data, and the footprint of a pixel on one.

All images lie one after the other in one array of texels, RGBA in the bytes of a word from the lowest up; a table says
where each begins and how it is read. A texture's uv are u right and v up.
"""

import warp as wp

REPEAT = wp.constant(0)
CLAMP = wp.constant(1)
MIRROR = wp.constant(2)

mat23 = wp.types.matrix(shape=(2, 3), dtype=wp.float32)
"""An affine map of uv."""


@wp.struct
class TextureRow:
    """A texture; ``first`` is its first texel, −1 for a checkerboard; ``decoding`` where its byte table begins.

    ``coarse`` is where its ``levels`` begin, each of half as many rows and columns as the one before.
    """

    first: int
    coarse: int
    levels: int
    width: int
    height: int
    wrap_u: int
    wrap_v: int
    nearest: int
    decoding: int
    uv_matrix: mat23  # type: ignore[valid-type]
    color_a: wp.vec3
    color_b: wp.vec3
    scale: float


@wp.struct
class Textures:
    """All textures; ``decoding`` holds what the 256 bytes mean as plain numbers, and then as sRGB.

    ``coarse`` is the texels of all coarser levels: of means over 2×2, 4×4 … of the others.
    """

    rows: wp.array[TextureRow]
    texels: wp.array[wp.uint32]
    coarse: wp.array[wp.uint32]
    decoding: wp.array[float]


@wp.struct
class Spot:
    """Where an image is read: four texels, counted from the first of all images, and how much the later ones count.

    ``decoding`` is the image's own; −1 where there is none.
    """

    upper_left: int
    upper_right: int
    lower_left: int
    lower_right: int
    right_share: float
    bottom_share: float
    decoding: int


@wp.struct
class Footprint:
    """What a pixel shows of a flat surface: uv over distance, and 1 over distance, at its corners.

    Both are linear in the picture: so perspective is kept. The corners' order is top left, right, and below likewise.
    """

    top_left: wp.vec3
    top_right: wp.vec3
    bottom_left: wp.vec3
    bottom_right: wp.vec3


@wp.func
def uv_in(footprint: Footprint, x: float, y: float) -> wp.vec2:
    """Return the uv at a place in the pixel, whose corners are at 0 and 1."""
    top = footprint.top_left + (footprint.top_right - footprint.top_left) * x
    bottom = footprint.bottom_left + (footprint.bottom_right - footprint.bottom_left) * x
    both = top + (bottom - top) * y
    return wp.vec2(both[0] / both[2], both[1] / both[2])
