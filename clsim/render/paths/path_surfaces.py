# ruff: noqa: SIM102, UP018
"""What a path meets: what its surface is made of, and what a pixel shows of it, as Warp functions."""

from typing import Any

import warp as wp

from clsim.render.accel.geometry import Surface
from clsim.render.bsdf.coats import base_color
from clsim.render.camera.pixel_width import width_at
from clsim.render.emitters.lights import LightSample
from clsim.render.features.bsdf_kinds import DIFFUSE, PLASTIC, PRINCIPLED
from clsim.render.features.features import Features
from clsim.render.kernel_input import Scene
from clsim.render.paths.towards_light import looks_ahead
from clsim.render.sampling import sampling
from clsim.render.sampling.sobol import make_sampler
from clsim.render.surfaces.blends import FIRST, mixes_textures
from clsim.render.surfaces.materials import Bsdf, Materials, has_details
from clsim.render.textures.ray_footprint import patch_round

_PLACES = wp.constant(8)
"""Places around a primary ray, of which the mean of a texture is taken."""


def make_is_analytic(features: Features) -> Any:
    """Return the Warp function ``is_analytic``: whether the light of lamps on a surface is, where it is for any."""

    @wp.func
    def is_analytic(materials: Materials, bsdf: Bsdf, material: int) -> bool:
        found = bool(bsdf.kind == DIFFUSE)
        if wp.static(features.coats):
            row = materials.rows[material]
            even = row.roughness_texture < 0
            found = found or (bsdf.kind == PLASTIC and not bsdf.dark and even)
            # Cells know the mean light of all that a normal map bends; to see each bend would take many rays.
            even = even and row.normal_texture < 0 and row.bump_texture < 0
            lambertian = row.metallic == 0.0 and row.transmission == 0.0
            found = found or (bsdf.kind == PRINCIPLED and not bsdf.dark and even and lambertian)
        return found

    return is_analytic


def make_meet(
    features: Features, primary_only: bool, materials: tuple[Any, ...], pick: Any, mapped_normal: Any, look_ahead: Any
) -> Any:
    """Return the Warp function ``meet``: what a surface is made of where a path meets it.

    ``materials`` is what `make_materials` returns, ``look_ahead`` what `make_towards_light` does.
    """
    resolve, _, _, foresee, texture_seen, _, textured, coloured, texture_at, mean_texture = materials
    uniform2 = make_sampler(features.sobol)
    ahead = looks_ahead(features) and not primary_only
    is_analytic = make_is_analytic(features)

    @wp.func(inline=True)
    def meet(
        scene: Scene,
        point: Surface,
        direction: wp.vec3,
        far: float,
        depth: int,
        goes_on: bool,
        stream: sampling.Stream,
        choice: float,
        width: wp.vec2,
        time: float,
    ) -> tuple[wp.vec3, Bsdf, wp.vec3, LightSample]:
        """Return the normal that light sees, the surface's material, and the normal by which light is cached.

        Last comes the light that was asked first, where rays to lights go before textures are read. ``far`` is how far
        the ray came.
        """
        # The caller keeps its own point: arguments are copies.
        dimension = (depth + 1) * sampling.DIMENSIONS_PER_BOUNCE
        if wp.static(features.blends):
            chance = FIRST
            if wp.static(not primary_only):
                chance = uniform2(stream, dimension + sampling.LOBE)[1]
            point.material = pick(scene.materials, point, chance)
        # The cache uses the normal without its map: cells hold the mean of all that the map bends.
        kept_normal = point.shading_normal
        if wp.static(features.normal_maps and not (primary_only and features.light_cache)):
            point.shading_normal = mapped_normal(scene.materials, point, -direction)
        light = LightSample()
        if wp.static(ahead):
            spot = foresee(scene.materials, point)
            if goes_on:
                light = look_ahead(scene, point, stream, dimension, choice, time)
        if wp.static(primary_only and features.textures):
            texture = wp.vec3()
            if width[0] + width[1] > 0.0 and depth == 0 and textured(scene.materials, point.material):
                patch = patch_round(point, direction, width_at(width, far))
                texture = mean_texture(scene.materials, point, patch, _PLACES)
            else:
                texture = texture_at(scene.materials, point)
            bsdf = coloured(scene.materials, point, texture)
        elif wp.static(ahead):
            bsdf = coloured(scene.materials, point, texture_seen(scene.materials, point, spot))
        else:
            bsdf = resolve(scene.materials, point)
        if wp.static(not features.light_cache):
            kept_normal = point.shading_normal
        if wp.static(features.normal_maps and features.light_cache):
            if bsdf.mirror or (wp.static(features.lamp_light) and is_analytic(scene.materials, bsdf, point.material)):
                if wp.static(primary_only):
                    point.shading_normal = mapped_normal(scene.materials, point, -direction)
                kept_normal = point.shading_normal
        return point.shading_normal, bsdf, kept_normal, light

    return meet


def make_colours(features: Features, albedo_of: Any, shares: Any, mean_of_blend: Any) -> Any:
    """Return the Warp function ``colours``: the albedo that a pixel shows of a surface, and that of a coat over it.

    ``shares`` is of `make_coats`, ``mean_of_blend`` of `make_blends`.
    """

    @wp.func(inline=True)
    def colours(
        scene: Scene, bsdf: Bsdf, point: Surface, kept_normal: wp.vec3, direction: wp.vec3, tint: wp.vec3
    ) -> tuple[wp.vec3, wp.vec3, float]:
        """Return both, and which share of its light the base of ``bsdf`` sends through its coat.

        Where there is none, that is 1 and the coat's albedo is 0. ``tint`` is what mirrors on the way here left.
        """
        cosine = -wp.dot(direction, kept_normal)
        own = shares(scene.materials, bsdf, cosine)
        albedo = base_color(bsdf, albedo_of(bsdf)) if wp.static(features.coats) else albedo_of(bsdf)
        albedo = albedo * own[0]
        coat = float(own[1])
        if wp.static(features.blends):
            # Of a blend, one material is drawn; the mean of what all send out is light of the blend.
            mean = mean_of_blend(scene.materials, point, cosine)
            albedo = wp.vec3(mean[0], mean[1], mean[2])
            coat = mean[3]
        return wp.cw_mul(tint, albedo), tint * coat, own[0]  # type: ignore[return-value]

    return colours


def make_detailed(features: Features, textured: Any) -> Any:
    """Return the Warp function ``detailed``: whether a material has detail that is finer than a pixel."""

    @wp.func
    def detailed(materials: Materials, material: int) -> bool:
        found = bool(False)
        if wp.static(features.textures):
            found = has_details(materials, material, textured(materials, material))
            if wp.static(features.blends):
                found = found or mixes_textures(materials, material)
        return found

    return detailed
