# Warp: a variable that changes must be born by a call, and wp.static drops a branch only where it stands alone.
# ruff: noqa: SIM102, UP018
"""The path tracing kernel, built for what a scene has.

Paths with next-event estimation and Russian roulette; both ways to light share by the power heuristic (Veach 1997).
"""

from typing import Any

import warp as wp

from clsim.render import sampling
from clsim.render.absorption import absorption_towards, dimmed
from clsim.render.alpha import make_alpha
from clsim.render.blends import FIRST, make_blends, mixes_textures
from clsim.render.bsdf import make_bsdf
from clsim.render.bsdf_kinds import DIFFUSE, PLASTIC
from clsim.render.bsdf_plastic import base_albedo, passing_out
from clsim.render.camera import CameraState
from clsim.render.compiler import kernel_options, one_at_a_time
from clsim.render.corners import make_flat_surfaces
from clsim.render.environment import foresee_environment
from clsim.render.features import Features
from clsim.render.film import Sample, make_film
from clsim.render.first_hits import make_look
from clsim.render.gather import make_gather, make_plain
from clsim.render.geometry import Hit, Tree, make_sphere_at, offset_origin
from clsim.render.guards import meets_guard
from clsim.render.intersection import face, make_intersection
from clsim.render.kernel_input import Scene, Settings
from clsim.render.lamp_light import AT_NONE, make_lamp_light, rim_draw, rim_place
from clsim.render.light_tree import Receiver, make_receiver
from clsim.render.lights import LightSample, make_lights, make_side
from clsim.render.materials import Materials, has_details, make_materials
from clsim.render.mis import make_weight
from clsim.render.normal_maps import make_normal_maps
from clsim.render.ray_footprint import patch_round
from clsim.render.shots import make_shoot, make_shoot_at
from clsim.render.sobol import make_sampler
from clsim.render.towards_light import looks_ahead, make_towards_light

_DIMENSIONS = wp.constant(sampling.DIMENSIONS_PER_BOUNCE)
_NEVER = wp.constant(1.0e-9)
_FAR = wp.constant(1.0e30)
_PLACES = wp.constant(8)
"""Places round a ray that only looks, of which the mean of a texture is taken."""


@one_at_a_time
def build_kernel(features: Features, tree: Tree = "warp") -> Any:
    """Return the kernel ``render(scene, camera, settings, first_pixel, every, out_planes, out_bits)``.

    A thread is one in ``every`` pixels. ``out_planes`` is float32 ``[C, H·W]`` and ``out_bits`` the same memory as
    unsigned integers. Where first hits are sampled apart, it is the kernel of ``steered.py``, and for requests one of
    ``retraced.py``.
    """
    closest, occluded, surface, surface_of = make_intersection(features, tree)
    sphere_at = make_sphere_at(features)
    resolve, emitted, opacity, foresee, texture_seen, lit_sides, *about_textures = make_materials(features)
    textured, coloured, texture_at, mean_texture = about_textures
    outgoing, scatter_value, scatter, albedo_of = make_bsdf(features)
    mapped_normal = make_normal_maps(features)
    pick, mean_of_blend = make_blends(features, resolve, albedo_of)
    pierce, transmittance = make_alpha(features, closest, surface_of, opacity)
    side = make_side(features)
    glossy = features.kinds != ("diffuse",)
    refracts = "dielectric" in features.kinds or "disney" in features.kinds

    @wp.func
    def shining(materials: Materials, point: Any) -> wp.vec3:
        """Return what a lamp sends out on average over the rays that its cut-outs stop or let through."""
        radiance = emitted(materials, point)
        if wp.static(features.alpha):
            radiance = radiance * opacity(materials, point)
        return radiance

    receiver = make_receiver(features)
    sample_light, triangle_pdf, sphere_pdf, environment, on_lamp = make_lights(features, surface, shining)
    add, merge, store = make_film(features.variances, features.sobol)
    uniform2 = make_sampler(features.sobol)
    by_light = features.strategy != "scatter"
    by_scatter = features.strategy != "light"
    has_lights = features.triangle_lights or features.sphere_lights or features.punctual_lights or features.environment

    @wp.func
    def closest_opaque(
        scene: Scene, origin: wp.vec3, direction: wp.vec3, time: float, stream: sampling.Stream, depth: int
    ) -> Hit:
        if wp.static(features.alpha or features.culled_backs):
            word = sampling.stream_word(stream.key, depth * _DIMENSIONS + sampling.LOBE)
            return pierce(scene.geometry, scene.materials, origin, direction, time, word, depth == 0)
        return closest(scene.geometry, origin, direction, time)

    agree, visibility, look_ahead = make_towards_light(features, occluded, transmittance, sample_light, lit_sides)
    ahead = looks_ahead(features)
    weight = make_weight(features)

    def trace(
        scene: Scene,
        start: wp.vec3,
        toward: wp.vec3,
        time: float,
        settings: Settings,
        stream: sampling.Stream,
        to_lamps: int,
        width: float,
    ) -> Sample:
        sample = Sample()
        origin = start
        direction = toward
        throughput = wp.vec3(1.0, 1.0, 1.0)
        pdf = float(1.0)
        alone = bool(True)
        # What the planes show: the first surface, or the first that is no mirror.
        looking = bool(True)
        tint = wp.vec3(1.0, 1.0, 1.0)
        passed_m = float(0.0)
        # The product of squared relative indices, by which radiance, but not power, was divided on the way.
        eta2 = float(1.0)
        # Of the glass that the ray is in [m⁻¹].
        absorption = wp.vec3()
        # Where the ray was scattered, for the densities with which the lights would have been drawn there.
        last = Receiver()
        last.position = start
        last.normal = toward
        # Where the light of lamps is found apart; the probability with which other light was drawn at the last place.
        apart = bool(False)
        others = float(1.0)
        for depth in range(settings.max_depth):
            if wp.static(features.environment_map and by_light and not only_look):
                foreseen = uniform2(stream, (depth + 1) * _DIMENSIONS + sampling.LIGHT)
                foresee_environment(scene.lights.environment_image, foreseen)
            hit = closest_opaque(scene, origin, direction, time, stream, depth)
            if wp.static(only_look and features.keeps_looks):
                far = wp.where(hit.triangle >= 0 or hit.sphere >= 0, hit.t, _FAR)
                sample.guarded = sample.guarded or meets_guard(scene.geometry, origin, direction, far)
            if wp.static(features.absorption):
                if hit.triangle >= 0 or hit.sphere >= 0:
                    left = dimmed(absorption, hit.t)
                    throughput = wp.cw_mul(throughput, left)
                    tint = wp.cw_mul(tint, left)
            if hit.triangle < 0:
                if wp.static(features.first_hits):
                    if looking:
                        sample.triangle = 0
                if wp.static(features.sphere_lights):
                    if hit.sphere >= 0:
                        drawn = sphere_pdf(scene.lights, scene.geometry, hit.sphere, last, time)
                        radiance = scene.lights.sphere_radiance[hit.sphere]
                        sample.radiance += wp.cw_mul(throughput, radiance) * weight(alone, others < 1.0, pdf, drawn)
                        if looking:
                            sphere = sphere_at(scene.geometry, hit.sphere, time)
                            centre = wp.vec3(sphere[0], sphere[1], sphere[2])
                            sample.hit = True
                            sample.depth = passed_m + hit.t
                            sample.albedo = wp.vec3()
                            sample.normal = wp.normalize(origin + direction * hit.t - centre)
                            if wp.static(features.first_hits):
                                sample.position = origin + direction * hit.t
                                sample.emission = sample.radiance
                        break
                if wp.static(features.environment):
                    sky = environment(scene.lights, last.normal, direction)
                    sample.radiance += wp.cw_mul(throughput, sky.radiance) * weight(alone, False, pdf, sky.pdf / others)
                    if wp.static(features.first_hits):
                        if looking:
                            sample.emission = sample.radiance
                break

            point = face(surface_of(scene.geometry, hit, time), direction)
            whole = point.material
            if wp.static(features.blends):
                chance = FIRST
                if wp.static(not only_look):
                    chance = uniform2(stream, (depth + 1) * _DIMENSIONS + sampling.LOBE)[1]
                point.material = pick(scene.materials, point, chance)
            # Light is kept by how a surface lies, without its normal map: cells know the mean of all that it bends.
            kept_normal = point.shading_normal
            if wp.static(features.normal_maps and not (only_look and features.light_cache)):
                point.shading_normal = mapped_normal(scene.materials, point, -direction)
            dimension = (depth + 1) * _DIMENSIONS
            choice = uniform2(stream, dimension + sampling.CHOICE)
            light = LightSample()
            if wp.static(ahead and not only_look):
                spot = foresee(scene.materials, point)
                if depth + 1 < settings.max_depth:
                    light = look_ahead(scene, point, stream, dimension, choice[0], time)
            if wp.static(only_look and features.textures):
                texture = wp.vec3()
                if width > 0.0 and depth == 0 and textured(scene.materials, point.material):
                    patch = patch_round(point, direction, width * hit.t)
                    texture = mean_texture(scene.materials, point, patch, _PLACES)
                else:
                    texture = texture_at(scene.materials, point)
                bsdf = coloured(scene.materials, point, texture)
            elif wp.static(ahead and not only_look):
                bsdf = coloured(scene.materials, point, texture_seen(scene.materials, point, spot))
            else:
                bsdf = resolve(scene.materials, point)
            if wp.static(not features.light_cache):
                kept_normal = point.shading_normal
            if wp.static(features.normal_maps and features.light_cache):
                if bsdf.mirror or (wp.static(features.lamp_light) and bsdf.kind == DIFFUSE):
                    if wp.static(only_look):
                        point.shading_normal = mapped_normal(scene.materials, point, -direction)
                    kept_normal = point.shading_normal
            point.material = whole
            followed = bool(False)
            looked_at = looking
            if looking:
                passed_m += hit.t
                sample.hit = True
                sample.depth = passed_m
                sample.normal = kept_normal
                sample.albedo = wp.cw_mul(tint, albedo_of(bsdf))
                if wp.static(features.blends):
                    sample.albedo = wp.cw_mul(tint, mean_of_blend(scene.materials, point))
                looking = False
                if wp.static(features.coats):
                    sample.coat = wp.vec3()
                    if bsdf.kind == PLASTIC and not bsdf.dark:
                        cosine = -wp.dot(direction, kept_normal)
                        passing = passing_out(scene.materials.transmittance, bsdf, cosine)
                        sample.coat = tint * (1.0 - passing)
                        sample.albedo = wp.cw_mul(tint, base_albedo(bsdf)) * passing
                        if wp.static(not only_look):
                            # Half of the paths find what the base sends out, half what the coat reflects.
                            sample.in_coat = (stream.key >> wp.uint64(20)) & wp.uint64(1) == wp.uint64(1)
                            if sample.in_coat:
                                bsdf.color = wp.vec3()
                                sample.albedo = sample.coat
                            else:
                                bsdf.specular = wp.vec3()
                if wp.static(features.follow_specular):
                    followed = bsdf.mirror
                    if wp.static(features.blends):
                        followed = followed and scene.materials.rows[whole].blend_with < 0
                    looking = followed
            if wp.static(features.triangle_lights):
                radiance = emitted(scene.materials, point)
                if radiance[0] + radiance[1] + radiance[2] > 0.0:
                    drawn = triangle_pdf(scene.lights, hit.instance, hit.triangle, point, direction, last)
                    sample.radiance += wp.cw_mul(throughput, radiance) * weight(alone, others < 1.0, pdf, drawn)
            if wp.static(features.first_hits):
                if looked_at:
                    sample.position = point.position
                    sample.emission = sample.radiance
                    sample.uv = point.uv
                    sample.front = point.front
                    sample.material = wp.where(depth == 0, point.material + 1, 0)
                    sample.triangle = wp.where(depth == 0, 1 + hit.triangle + hit.instance * 65537, 0)
                    if wp.static(features.textures):
                        averaged = textured(scene.materials, point.material)
                        detailed = has_details(scene.materials, point.material, averaged)
                        if wp.static(features.blends):
                            detailed = detailed or mixes_textures(scene.materials, point.material)
                        if detailed:
                            # Rays look for what is finer than a pixel, as for what is small.
                            sample.triangle = 0
                if wp.static(features.lamp_light):
                    apart = looked_at and not looking and bsdf.kind == DIFFUSE
                    sample.lamp = sample.lamp or apart
                if wp.static(only_look):
                    if not looking and not (apart and to_lamps != AT_NONE):
                        break
            if depth + 1 >= settings.max_depth or bsdf.dark:
                break

            to = receiver(bsdf, point.position, point.shading_normal, -direction)
            draw = choice[0]
            asks = not bsdf.mirror
            if wp.static(features.lamp_light):
                others = wp.where(apart, wp.max(scene.lights.environment_probability, _NEVER), 1.0)
                if apart:
                    # The lamps come first, and then the environment.
                    if wp.static(only_look):
                        draw = draw * (1.0 - others)
                    else:
                        asks = others > _NEVER
                        draw = 1.0 - others + draw * others
            out = outgoing(scene.materials, bsdf, point.shading_normal, -direction)
            if wp.static(by_light and has_lights):
                if asks:
                    if wp.static(not ahead):
                        u = uniform2(stream, dimension + sampling.LIGHT)
                        if wp.static(features.lamp_light and only_look):
                            if apart and to_lamps >= 0:
                                draw = rim_draw(scene.lights, to_lamps)
                                u = rim_place(to_lamps)
                        finer = sampling.uniform_of(sampling.stream_word(stream.key, dimension + sampling.CHOICE), 0)
                        light = sample_light(
                            scene.lights, scene.geometry, scene.materials, point, to, draw, finer, u, time
                        )
                    if wp.static(features.lamp_light and not only_look):
                        light.pdf = light.pdf / others
                    if light.pdf > 0.0 and agree(point, light.direction):
                        scattering = scatter_value(scene.materials, bsdf, point.shading_normal, out, light.direction)
                        value = wp.cw_mul(wp.cw_mul(throughput, light.radiance), scattering.value)
                        if wp.static(features.lamp_light):
                            # Of the lamps alone: which rays meet the bright squares of a texture makes no shadow.
                            facing = wp.max(wp.dot(light.direction, point.shading_normal), 0.0)
                            sample.lamp_all = sampling.luminance(light.radiance) * facing / light.pdf
                        lit_here = bool(value[0] + value[1] + value[2] > 0.0)
                        if wp.static(features.lamp_light and only_look):
                            # What is black tells as well whether the lamps' light arrives there.
                            lit_here = sample.lamp_all > 0.0
                        if lit_here:
                            if wp.static(not ahead):
                                light.visible = visibility(scene, light.origin, light.direction, light.distance, time)
                            if wp.static(only_look and features.keeps_looks):
                                passes = meets_guard(scene.geometry, light.origin, light.direction, light.distance)
                                sample.guarded = sample.guarded or passes
                            if light.visible > 0.0:
                                w = light.visible
                                if wp.static(features.environment_map):
                                    if light.mapped:
                                        sky = environment(scene.lights, point.shading_normal, light.direction)
                                        value = wp.cw_mul(value, sky.radiance)
                                        # Beside a cell that is black, roundings may end in it.
                                        light.pdf = wp.max(sky.pdf / others, 1.0e-30)
                                if wp.static(features.absorption):
                                    way = absorption_towards(scene.materials, point, light.direction, absorption)
                                    value = wp.cw_mul(value, dimmed(way, light.distance))
                                if wp.static(by_scatter):
                                    if not light.delta:
                                        w = w * sampling.power_heuristic(light.pdf, scattering.pdf)
                                sample.radiance += value * (w / light.pdf)
                                if wp.static(features.lamp_light):
                                    sample.lamp_lit = sample.lamp_all * light.visible
            if wp.static(features.lamp_light):
                if wp.static(only_look):
                    if not looking:
                        break

            lobe = float(0.0)
            if wp.static(glossy):
                lobe = uniform2(stream, dimension + sampling.LOBE)[0]
            u = uniform2(stream, dimension + sampling.SCATTER)
            scattered = scatter(scene.materials, bsdf, point.shading_normal, out, lobe, u)
            if (scattered.pdf <= 0.0 and not scattered.delta) or not agree(point, scattered.direction):
                break
            direction = scattered.direction
            if wp.static(features.absorption):
                absorption = absorption_towards(scene.materials, point, direction, absorption)
            pdf = scattered.pdf
            alone = scattered.delta
            throughput = wp.cw_mul(throughput, scattered.weight)
            if wp.static(refracts):
                eta2 = eta2 * scattered.eta2
            if wp.static(features.follow_specular):
                if followed:
                    tint = wp.cw_mul(tint, scattered.weight)
                    if wp.static(refracts):
                        tint = tint * scattered.eta2
            survival = wp.min(wp.max(throughput[0], wp.max(throughput[1], throughput[2])) * eta2, 0.95)
            if survival <= 0.0:
                break
            if depth + 1 >= settings.roulette_start:
                if choice[1] >= survival:
                    break
                throughput = throughput / survival
            last = to
            origin = offset_origin(point.position, side(point.normal, direction), point.reach_m)
        return sample

    # Twice: rays that only look go without all that paths need. Each is called from one place, where the compiler puts
    # it whole; else the scene would be copied for each call.
    only_look = False
    shoot = make_shoot(features.sobol, make_shoot_at(features, wp.func(trace)))
    only_look = True
    glimpse_at = make_shoot_at(features, wp.func(trace, inline=True), inline=True)

    flat, mean_albedo = make_flat_surfaces(textured, coloured, mean_texture, albedo_of, features.coats)
    types = Scene, CameraState, Settings
    gather = make_gather(features.sobol, shoot, add, merge, *types)
    lamps = make_lamp_light(features, on_lamp, shining) if features.lamp_light else None
    mean_albedo = mean_albedo if features.textures else None
    about_light = features.coats, features.shadow_rays
    look = make_look(features.sobol, features.sharp, *about_light, glimpse_at, flat, mean_albedo, lamps, *types)
    # Imported where they are needed: Warp reads each function when it is defined.
    if features.requests:
        from clsim.render.retraced import make_retraced

        paths, first_hits, in_kept_light = make_retraced(look, gather, store, *types, kernel_options())
        if features.light_cache:
            return in_kept_light
        return first_hits if features.first_hits else paths
    if features.first_hits:
        make: Any
        if features.light_cache:
            from clsim.render.cached import make_cached as make
        elif features.in_turn:
            from clsim.render.in_turn import make_in_turn as make
        else:
            from clsim.render.steered import make_steered as make
        kept = (features.keeps_looks,) if features.in_turn else ()
        return make(features.sobol, *kept, look, shoot, *types, kernel_options())

    return make_plain(gather, store, *types, kernel_options())
