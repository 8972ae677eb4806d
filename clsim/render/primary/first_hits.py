# ruff: noqa: UP018, SIM102, RUF046
"""Primary rays: what a pixel shows, by the first hits alone.

Rays at a pixel's four corners come first. A straight edge of something that is larger than a pixel leaves at least one
corner on each of its sides; so where all four corners see the same, and a few rays inside do too, the pixel shows one
surface. Where they show two, the places at which the edge crosses the pixel's border are found by bisection, and the
share of each side is an area in closed form: k rays place a crossing to 2⁻ᵏ of a pixel, where counting n points
anywhere in the pixel is right to about n^-¾. Rays inside tell the colours of both sides, and whether the edge is
straight. Where it is not, or more than two surfaces are seen, shares are counted.

An edge is one between surfaces, or, on one surface, between two colours. Where a pixel shows one flat surface with a
texture, no rays are needed to know its colour: the places on it follow from those of the corners (perspective is linear
in the inverse of the distance), and the mean of the texture over many of them is taken.
"""

from typing import Any

import warp as wp

from clsim.render.camera.film import Sample
from clsim.render.primary.corners import between_corners, centre_surface, footprint_of, on_flat_surface
from clsim.render.primary.edges import Edge, is_sound, make_judge, narrow, next_side, off_line, on_side
from clsim.render.primary.lamp_light import same_light
from clsim.render.primary.ray_numbers import PrimaryRays, primary_in_shadow, wanted_inside
from clsim.render.primary.seen_surfaces import (
    DARK,
    SeenSurface,
    add_to_surface,
    begin_surface,
    find_surface,
    finish_surfaces,
    resume_surfaces,
    same_colour,
)
from clsim.render.primary.shadow_rays import (
    AT_ANY,
    AT_NONE,
    MOST_TOLD,
    Shadow,
    Shadows,
    are_told,
    corner_kind,
    next_that_differs,
    off_straight,
    start_at,
    straight,
)
from clsim.render.sampling import sampling
from clsim.render.sampling.sobol import make_sampler, reverse_bits
from clsim.render.textures.texture_data import Footprint

_CORNER = wp.constant(-3)
"""Number of the random numbers of rays at corners; they matter where glass or cut-outs choose a way."""


@wp.struct
class Reach:
    """Where the rays of a pixel led.

    Attributes:
        hit: whether they hit anything, …
        lower, upper: … corners of the box around all of it, …
        sky: … whether any hit nothing, …
        sky_lower, sky_upper: … corners of the box around places in the sky, …
        bent: … and whether a mirror or glass sent any of them on.
    """

    hit: bool
    lower: wp.vec3
    upper: wp.vec3
    sky: bool
    sky_lower: wp.vec3
    sky_upper: wp.vec3
    bent: bool


@wp.struct
class Seen:
    """How many surfaces a pixel shows, and how many rays it took, of which some were ``inside``.

    ``counted`` is whether shares are counted by them, ``by_colour`` whether each colour of a surface counts as one.
    ``shadow`` tells which of the latter reached the lamps, where it shows one triangle; where that is plain without
    them, they are 0, and its first bit is for all of the pixel. ``reach`` is told where what was seen is stored.
    """

    surfaces: int
    rays: int
    inside: int
    counted: bool
    by_colour: bool
    shadow: Shadow
    reach: Reach


@wp.func
def _extend(reach: wp.array[Reach], sample: Sample) -> None:
    """Let a pixel's rays have led to where one did."""
    reach[0].bent = reach[0].bent or sample.bent
    if sample.hit:
        reach[0].lower = wp.where(reach[0].hit, wp.min(reach[0].lower, sample.position), sample.position)
        reach[0].upper = wp.where(reach[0].hit, wp.max(reach[0].upper, sample.position), sample.position)
        reach[0].hit = True
    else:
        reach[0].sky_lower = wp.where(reach[0].sky, wp.min(reach[0].sky_lower, sample.position), sample.position)
        reach[0].sky_upper = wp.where(reach[0].sky, wp.max(reach[0].sky_upper, sample.position), sample.position)
        reach[0].sky = True


@wp.func
def _pixel_below(corner: int, width: int) -> int:
    """Return a pixel that has that corner at its top: of its number, but for a row's last."""
    return corner // (width + 1) * width + wp.min(corner % (width + 1), width - 1)


@wp.func
def _take_in(
    surfaces: wp.array[SeenSurface],
    number: int,
    edge: wp.array[Edge],
    sample: Sample,
    place: wp.vec2,
    footprint: Footprint,
    corner: Sample,
    pixel: wp.vec2,
    coats: bool,
) -> int:
    """Add what a ray inside a pixel saw, and judge by it what the ``corner`` and the others told of the edge.

    Returns:
        The number of surfaces.
    """
    known = number
    k = int(0)
    if edge[0].flat:
        edge[0].flat = on_flat_surface(footprint, corner, sample, place, pixel)
        edge[0].plain = edge[0].plain and edge[0].flat
    if not edge[0].flat:
        k = find_surface(surfaces, known, sample, edge[0].by_colour, pixel)
    if k < 0:
        edge[0].plain = edge[0].plain and known == 0
        edge[0].straight = False
        if k == -1:
            known = begin_surface(surfaces, known, sample)
            k = known - 1
        else:
            k = -2 - k
    elif edge[0].straight and not same_colour(sample, surfaces[k].first):
        edge[0].varied = True
    if edge[0].straight:
        edge[0].straight = not off_line(edge[0].place, edge[0].along, place, k == 0)
    edge[0].shaded = edge[0].shaded or not same_light(sample, surfaces[k].first)
    add_to_surface(surfaces, k, sample, coats)
    return known


def make_sample_primary(
    sobol: bool,
    edges: bool,
    coats: bool,
    records: bool,
    reaches: bool,
    shoot_at: Any,
    shadow_ray: Any,
    flat: Any,
    mean_albedo: Any,
    light_surfaces: Any,
    wide_lamps: bool,
    scene_type: Any,
    view_type: Any,
    settings_type: Any,
) -> Any:
    """Return the Warp function ``sample_primary``.

    ``sample_primary(scene, camera, settings, pixel, instant, state, primary_rays, corner, corners, nearest, row,
    before, shadows, surfaces)`` returns `Seen`. It samples a pixel where ``corner`` is -1, and needs what its corners
    see first: the top left one's is in ``corners[nearest]``, and those below ``row`` farther on. With the number of a
    corner, of which there is one more in a row than there are pixels, it samples that one alone, and writes what it
    sees to ``corners[nearest]``. Where shares are ``counted`` in what fewer rays saw ``before``, it goes on from there.

    Args:
        sobol: whether rays inside a pixel are spread evenly.
        edges: whether a ray sees what lies at its place in the pixel, and nothing else: no blur of any sort.
        coats: whether some surfaces have a coat, whose light the cache holds separately.
        records: whether it records which rays reached the lamps, and ``shadows`` tell it of the frames around.
        reaches: whether it tells where rays led.
        shoot_at: ``shoot_at(scene, camera, settings, pixel, place, instant, stream, width, wanted) -> Sample``.
        shadow_ray: of `make_shadow_ray`, which goes on from there to a lamp; None where direct light is not analytic.
        flat: ``flat(scene, sample) -> bool``: whether a texture tells the albedo of its surface.
        mean_albedo: ``mean_albedo(scene, like, footprint, places) -> wp.vec3``, of that surface; None without textures.
        light_surfaces: adds analytic direct light to surfaces (``lamp_light.py``); None where paths find it.
        wide_lamps: whether some of these lamps have a size.
        scene_type, view_type, settings_type: structs of the first three.
    """
    uniform2 = make_sampler(sobol)
    judge_corners = make_judge(flat, wide_lamps, scene_type, settings_type)

    @wp.func
    def paint(
        scene: scene_type, surfaces: wp.array[SeenSurface], corner: Sample, footprint: Footprint, texels: int
    ) -> None:
        """Give the one surface that a pixel shows the mean albedo of its texture."""
        like = corner
        if wp.static(coats):
            like.passing = surfaces[0].passing
        albedo = mean_albedo(scene, like, footprint, texels)
        surfaces[0].albedo = wp.vec3(wp.max(albedo[0], DARK), wp.max(albedo[1], DARK), wp.max(albedo[2], DARK))

    # Both are called from one place, where the compiler puts them whole.
    @wp.func(inline=True)
    def begin(
        scene: scene_type,
        camera: view_type,
        settings: settings_type,
        instant: int,
        primary_rays: PrimaryRays,
        corner: int,
        corners: wp.array[Sample],
        nearest: int,
        row: int,
        before: Seen,
        edge: wp.array[Edge],
        surfaces: wp.array[SeenSurface],
    ) -> tuple[Footprint, int]:
        """Find what the corners, or the rays ``before``, tell of the edge; return the number of surfaces so far too."""
        number = int(0)
        footprint = Footprint()
        edge[0].plain = True
        edge[0].by_colour = True
        edge[0].side = 4
        if wp.static(edges):
            if primary_rays.steps > 0 and corner < 0 and not before.counted:
                edge[0] = judge_corners(
                    scene, settings, primary_rays.pixel, camera.clear_m[instant], instant, corners, nearest, row
                )
                if edge[0].flat:
                    footprint = footprint_of(corners, nearest, row, primary_rays.pixel)
                if edge[0].plain or edge[0].flat:
                    number = begin_surface(surfaces, number, corners[nearest])
                if edge[0].straight:
                    edge[0] = next_side(edge[0], 0, primary_rays.steps)
        if before.counted:
            edge[0].plain = False
            edge[0].by_colour = before.by_colour
            edge[0].rays = before.rays - before.inside
            number = before.surfaces
            resume_surfaces(surfaces, number)
        return footprint, number

    @wp.func(inline=True)
    def finish(
        scene: scene_type,
        primary_rays: PrimaryRays,
        instant: int,
        corner: int,
        corners: wp.array[Sample],
        nearest: int,
        row: int,
        edge: wp.array[Edge],
        footprint: Footprint,
        inside: int,
        number: int,
        told: bool,
        shadows: Shadows,
        more_light: wp.vec2,
        shadow: Shadow,
        surfaces: wp.array[SeenSurface],
    ) -> Seen:
        """Give the surfaces their shares, and what is known of them without rays."""
        finish_surfaces(surfaces, number, edge[0].straight, edge[0].area, wp.static(coats))
        # Where no ray was inside, the corners tell all.
        if (edge[0].plain or edge[0].flat) and primary_rays.steps > 0 and corner < 0:
            if inside == 0 or wp.static(light_surfaces is not None):
                centre_surface(surfaces, corners, nearest, row, wp.static(coats))
        if wp.static(edges and mean_albedo is not None):
            if edge[0].flat:
                paint(scene, surfaces, corners[nearest], footprint, primary_rays.texels)
        seen = Seen()
        if wp.static(records):
            if told:
                most = straight(shadows, shadows.before.lamp_all, shadows.after.lamp_all)
                lit = straight(shadows, shadows.before.lamp_lit, shadows.after.lamp_lit) + more_light[0]
                surfaces[0].lamp_all = most
                surfaces[0].lamp_lit = wp.clamp(lit, 0.0, most)
                if wp.static(coats):
                    most = straight(shadows, shadows.before.coat_all, shadows.after.coat_all)
                    lit = straight(shadows, shadows.before.coat_lit, shadows.after.coat_lit) + more_light[1]
                    surfaces[0].coat_all = most
                    surfaces[0].coat_lit = wp.clamp(lit, 0.0, most)
            elif inside <= MOST_TOLD:
                seen.shadow = shadow
                seen.shadow.rays = wp.where(edge[0].shaded, inside, 0)
                seen.shadow.lamp_all = surfaces[0].lamp_all
                seen.shadow.lamp_lit = surfaces[0].lamp_lit
                if wp.static(coats):
                    seen.shadow.coat_all = surfaces[0].coat_all
                    seen.shadow.coat_lit = surfaces[0].coat_lit
                if not edge[0].shaded:
                    seen.shadow.lit_rays = wp.uint64(wp.where(surfaces[0].lamp_lit > 0.0, 1, 0))
        if wp.static(light_surfaces is not None):
            light_surfaces(scene.lights, scene.geometry, scene.materials, surfaces, number, float(instant))
        seen.surfaces = number
        seen.rays = edge[0].rays + inside
        seen.inside = inside
        seen.by_colour = edge[0].by_colour
        seen.counted = number > 1 and not edge[0].straight
        return seen

    # Inlined too: a function of its own would copy the scene for each pixel.
    @wp.func(inline=True)
    def sample_primary(
        scene: scene_type,
        camera: view_type,
        settings: settings_type,
        pixel: int,
        instant: int,
        state: wp.uint64,
        primary_rays: PrimaryRays,
        corner: int,
        corners: wp.array[Sample],
        nearest: int,
        row: int,
        before: Seen,
        shadows: Shadows,
        surfaces: wp.array[SeenSurface],
    ) -> Seen:
        stream = sampling.Stream()
        # In memory of its own, and changed there: a struct that is assigned anew in a branch is copied for each ray.
        edge = wp.zeros(shape=1, dtype=Edge)
        footprint, number = begin(
            scene, camera, settings, instant, primary_rays, corner, corners, nearest, row, before, edge, surfaces
        )
        reach = wp.zeros(shape=1, dtype=Reach)
        if wp.static(reaches):
            reach[0] = before.reach
            if corner < 0 and primary_rays.steps > 0 and not before.counted:
                for i in range(4):
                    _extend(reach, corners[nearest + (i & 1) + (i // 2) * row])
        inside = int(before.inside)
        # Where it is told, only rays are traced that differ between the frames around; they find so much more light.
        told = bool(False)
        skipped = int(0)
        more_light = wp.vec2()
        shadow = Shadow()
        if wp.static(records):
            if edge[0].alone and (edge[0].plain or edge[0].flat):
                shadow.triangle = corners[nearest].triangle
                told = edge[0].shaded and are_told(shadows, shadow.triangle)
        # One place where rays are traced, whatever they are for: the tracer is compiled into each such place again.
        while True:
            at = int(pixel)
            places = edge[0].side < 4
            place = wp.vec2()
            if wp.static(edges):
                if corner >= 0:
                    stream.key = sampling.stream_key(sampling.absorb(sampling.absorb(settings.stream, _CORNER), corner))
                    stream.scrambling = stream.key
                    at = _pixel_below(corner, settings.width)
                    place = wp.vec2(float(corner % (settings.width + 1) - at % settings.width), 0.0)
                elif places:
                    stream.key = sampling.stream_key(sampling.absorb(state, _CORNER))
                    stream.scrambling = stream.key
                    place = on_side(edge[0], edge[0].low + edge[0].step)
            if corner < 0 and not places:
                if wp.static(records):
                    if told and (edge[0].whole or inside >= primary_rays.inside):
                        differs = next_that_differs(shadows, inside)
                        skipped = skipped + differs - inside
                        inside = differs
                if inside >= wp.where(told, shadows.before.rays, wanted_inside(edge[0], primary_rays)):
                    break
                if wp.static(sobol):
                    stream.scrambling = sampling.stream_key(sampling.absorb(state, -1))
                    stream.reversed_index = reverse_bits(wp.uint32(inside))
                stream.key = sampling.stream_key(sampling.absorb(state, inside))
                place = uniform2(stream, sampling.CAMERA)
            to_lamps = wp.where(places, AT_NONE, AT_ANY)
            if wp.static(edges):
                if corner >= 0:
                    to_lamps = corner_kind(corner % (settings.width + 1), corner // (settings.width + 1))
            # Rays inside a pixel that shows many surfaces share its area, and so the textures in it.
            width = primary_rays.pixel / wp.sqrt(float(primary_rays.most))
            if corner >= 0 or places or edge[0].flat:
                width = wp.vec2()
            # Where all is known but the shadow, the corners tell where on their triangle it is asked for.
            on_triangle = bool(False)
            if wp.static(shadow_ray is not None):
                if corner < 0 and not places and edge[0].shaded and edge[0].alone and (edge[0].plain or edge[0].flat):
                    on_triangle = edge[0].whole or inside >= primary_in_shadow(primary_rays)
            sample = shoot_at(scene, camera, settings, at, place, instant, stream, width, not on_triangle)
            if wp.static(reaches):
                # On its triangle, it is where the corners tell.
                if not on_triangle:
                    _extend(reach, sample)
            if wp.static(shadow_ray is not None):
                start = start_at(sample)
                if on_triangle:
                    start = between_corners(corners, nearest, row, place, primary_rays.pixel)
                if to_lamps != AT_NONE and start.reach_m > 0.0:
                    light = shadow_ray(scene, start, to_lamps, stream, float(instant))
                    sample.lamp_all = light[0]
                    sample.lamp_lit = light[1]
                    if wp.static(coats):
                        sample.coat_all = light[2]
                        sample.coat_lit = light[3]
            if wp.static(edges):
                if corner >= 0:
                    corners[nearest] = sample
                    break
            if places:
                edge[0] = narrow(edge[0], sample, corners, nearest, primary_rays.pixel, primary_rays.steps)
                if edge[0].side >= 4 and edge[0].straight:
                    number = begin_surface(surfaces, number, corners[nearest])
                    number = begin_surface(surfaces, number, corners[edge[0].second])
            else:
                if wp.static(records):
                    if not on_triangle and sample.triangle != shadow.triangle:
                        shadow.triangle = 0
                        if told:
                            # Something else came over the pixel: all rays are needed.
                            told = False
                            skipped = 0
                            inside = 0
                            continue
                    if told:
                        more_light += off_straight(shadows, inside, sample)
                    if sample.lamp_lit > 0.0 and inside < MOST_TOLD:
                        shadow.lit_rays |= wp.uint64(1) << wp.uint64(inside)
                inside = inside + 1
                if on_triangle:
                    if not told:
                        surfaces[0].lamp_all += sample.lamp_all
                        surfaces[0].lamp_lit += sample.lamp_lit
                        if wp.static(coats):
                            surfaces[0].coat_all += sample.coat_all
                            surfaces[0].coat_lit += sample.coat_lit
                elif is_sound(sample) and not told:
                    number = _take_in(
                        surfaces, number, edge, sample, place, footprint, corners[nearest], primary_rays.pixel, coats
                    )
        seen = finish(
            scene, primary_rays, instant, corner, corners, nearest, row, edge, footprint, inside - skipped, number,
            told, shadows, more_light, shadow, surfaces,
        )  # fmt: skip
        if wp.static(reaches):
            seen.reach = reach[0]
        return seen

    return sample_primary
