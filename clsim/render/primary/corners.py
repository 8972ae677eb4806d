"""The four corners of a pixel, and what they tell of it, as Warp functions.

``corners[nearest]`` is what the top left one sees, and those below stand ``row`` farther on.
"""

from typing import Any

import warp as wp

from clsim.render.accel.geometry import Surface
from clsim.render.bsdf.coats import base_color
from clsim.render.camera.film import Sample
from clsim.render.kernel_input import Scene
from clsim.render.primary.seen_surfaces import SeenSurface, lit_albedo, same_surface
from clsim.render.primary.shadow_rays import ShadowStart
from clsim.render.textures.texture_data import Footprint, uv_in

_OFF_UV = wp.constant(0.02)
"""Share of a pixel's extent on a flat surface by which a ray may end elsewhere than the corners tell."""


@wp.func
def corner_at(i: int) -> wp.vec2:
    """Return a corner of a pixel; i and i + 1 are the ends of a side."""
    k = i & 3
    return wp.vec2(wp.where(k == 1 or k == 2, 1.0, 0.0), wp.where(k >= 2, 1.0, 0.0))


@wp.func
def corner_near(k: int) -> wp.vec2i:
    """Return where a corner lies from a pixel's top left one: its own, 0 … 3, and two beyond each side, 4 … 11."""
    along = k & 1
    beyond = wp.where((k & 2) == 0, -1, 2)
    place = wp.vec2i(along, (k >> 1) & 1)
    if k >= 8:
        place = wp.vec2i(beyond, along)
    elif k >= 4:
        place = wp.vec2i(along, beyond)
    return place


@wp.func
def _over_distance(sample: Sample, pixel: wp.vec2) -> wp.vec3:
    # Parallel rays see a surface as it is: no part of it is farther, and so smaller, than another.
    return wp.vec3(sample.uv[0], sample.uv[1], 1.0) / wp.where(pixel[0] > 0.0, sample.depth, 1.0)


@wp.func
def footprint_of(corners: wp.array[Sample], nearest: int, row: int, pixel: wp.vec2) -> Footprint:
    """Return what the four corners tell of a flat surface; ``row`` is the number of corners in a row."""
    f = Footprint()
    f.top_left = _over_distance(corners[nearest], pixel)
    f.top_right = _over_distance(corners[nearest + 1], pixel)
    f.bottom_left = _over_distance(corners[nearest + row], pixel)
    f.bottom_right = _over_distance(corners[nearest + row + 1], pixel)
    return f


@wp.func
def between_corners(corners: wp.array[Sample], nearest: int, row: int, place: wp.vec2, pixel: wp.vec2) -> ShadowStart:
    """Return where a ray meets the one triangle that all four corners see."""
    start = ShadowStart()
    start.facing = corners[nearest].facing
    total = 0.0
    for i in range(4):
        k = nearest + (i & 1) + (i // 2) * row
        weight = wp.where((i & 1) == 1, place[0], 1.0 - place[0])
        weight *= wp.where(i >= 2, place[1], 1.0 - place[1])
        # Perspective is linear in the inverse of the distance.
        weight /= wp.where(pixel[0] > 0.0, corners[k].depth, 1.0)
        total += weight
        start.position += weight * corners[k].position
        start.normal += weight * corners[k].normal
        start.reach_m = wp.max(start.reach_m, corners[k].reach_m)
    start.position = start.position / total  # type: ignore[assignment]
    start.normal = wp.normalize(start.normal)  # type: ignore[assignment]
    start.coated_by = corners[nearest].coated_by
    eye = corners[nearest].position - corners[nearest].toward * corners[nearest].depth
    start.seen_from = wp.normalize(eye - start.position)
    return start


@wp.func
def on_flat_surface(footprint: Footprint, first: Sample, sample: Sample, place: wp.vec2, pixel: wp.vec2) -> bool:
    """Whether a ray saw the flat surface that the corners saw, where it should."""
    middle = uv_in(footprint, 0.5, 0.5)
    extent = wp.length(uv_in(footprint, 1.0, 0.5) - middle) + wp.length(uv_in(footprint, 0.5, 1.0) - middle)
    off = wp.length(sample.uv - uv_in(footprint, place[0], place[1]))
    near = off < _OFF_UV * extent + 1.0e-6
    return near and sample.material == first.material and same_surface(sample, first, pixel)


@wp.func
def centre_surface(
    surfaces: wp.array[SeenSurface], corners: wp.array[Sample], nearest: int, row: int, coats: bool
) -> None:
    """Put the one surface that a pixel shows at the mean of what its corners see: that of few rays is off centre."""
    if surfaces[0].rays <= 0.0:
        surfaces[0].emission = wp.vec3()
        surfaces[0].albedo = wp.vec3()
        if coats:
            surfaces[0].coat = wp.vec3()
            surfaces[0].passing = 0.0
        for i in range(4):
            corner = corners[nearest + (i & 1) + (i // 2) * row]
            surfaces[0].emission += 0.25 * corner.emission
            surfaces[0].albedo += 0.25 * lit_albedo(corner)
            if coats:
                surfaces[0].coat += 0.25 * corner.coat
                surfaces[0].passing += 0.25 * corner.passing
    p = corners[nearest].position + corners[nearest + 1].position
    surfaces[0].position = 0.25 * (p + corners[nearest + row].position + corners[nearest + row + 1].position)
    r = corners[nearest].rest + corners[nearest + 1].rest
    surfaces[0].rest = 0.25 * (r + corners[nearest + row].rest + corners[nearest + row + 1].rest)
    n = corners[nearest].normal + corners[nearest + 1].normal
    surfaces[0].normal = 0.25 * (n + corners[nearest + row].normal + corners[nearest + row + 1].normal)
    if surfaces[0].lamp_all <= 0.0:
        # No ray inside asked for the lamps' light.
        for i in range(4):
            corner = corners[nearest + (i & 1) + (i // 2) * row]
            surfaces[0].lamp_all += corner.lamp_all
            surfaces[0].lamp_lit += corner.lamp_lit
            surfaces[0].coat_all += corner.coat_all
            surfaces[0].coat_lit += corner.coat_lit
    d = corners[nearest].depth + corners[nearest + 1].depth
    surfaces[0].depth = 0.25 * (d + corners[nearest + row].depth + corners[nearest + row + 1].depth)


def make_flat_surfaces(textured: Any, coloured: Any, mean_texture: Any, albedo_of: Any, coats: bool) -> tuple[Any, Any]:
    """Return the Warp functions ``flat(scene, sample)`` and ``mean_albedo(scene, like, footprint, places)``.

    The first three arguments are of `make_materials`, the next is of `make_bsdf`; ``coats`` is of `Features`.
    """

    @wp.func
    def flat(scene: Scene, sample: Sample) -> bool:
        """Whether a ray saw a surface whose albedo over a pixel is known from its texture."""
        return sample.material > 0 and textured(scene.materials, wp.max(sample.material - 1, 0))

    @wp.func
    def mean_albedo(scene: Scene, like: Sample, footprint: Footprint, places: int) -> wp.vec3:
        """Return the mean albedo over a pixel of the surface that a ray saw."""
        point = Surface()
        point.uv = like.uv
        point.front = like.front
        point.material = like.material - 1
        texture = mean_texture(scene.materials, point, footprint, places)
        bsdf = coloured(scene.materials, point, texture)
        albedo = albedo_of(bsdf)
        if wp.static(coats):
            albedo = base_color(bsdf, albedo) * like.passing
        return albedo

    return flat, mean_albedo
