# ruff: noqa: SIM102, UP018
"""A path from the camera through the scene, or its primary ray alone.

Paths with next-event estimation and Russian roulette; both ways to light share by the power heuristic (Veach 1997).
"""

from typing import Any

import warp as wp

from clsim.render.accel.geometry import offset_origin
from clsim.render.accel.intersection import face
from clsim.render.accel.rest import make_rest
from clsim.render.bsdf.coats import one_part
from clsim.render.cache.trails import MOST_M, PLACES, note_light, note_place
from clsim.render.camera.film import Sample
from clsim.render.emitters.environment import foresee_environment
from clsim.render.emitters.light_tree import make_receiver
from clsim.render.emitters.lights import NEVER
from clsim.render.features.features import Features
from clsim.render.kernel_input import Scene, Settings
from clsim.render.paths.path_lights import Carried
from clsim.render.paths.path_surfaces import make_is_analytic
from clsim.render.sampling import sampling
from clsim.render.sampling.sobol import make_sampler
from clsim.render.surfaces.absorption import absorption_towards, dimmed

_DIMENSIONS = wp.constant(sampling.DIMENSIONS_PER_BOUNCE)


def make_trace(
    features: Features,
    primary_only: bool,
    closest: Any,
    surface_of: Any,
    meet: Any,
    colours: Any,
    detailed: Any,
    ending: Any,
    ask: Any,
    about_scattering: tuple[Any, Any, Any, Any],
    about_lamps: tuple[Any, Any, Any],
) -> Any:
    """Return ``trace(scene, start, toward, time, settings, stream, width, wanted)``, which becomes a Warp function.

    Args:
        features: what the kernel is built for.
        primary_only: end at the first surface that is no mirror, nor glossy, which is what a pixel shows.
        closest: finds the nearest hit that stops the ray.
        surface_of: of a hit.
        meet, colours, detailed: of `path_surfaces`.
        ending, ask: of `path_lights`.
        about_scattering: ``outgoing`` and ``scatter`` of `make_bsdf`, ``agree`` of `make_towards_light`, ``side``.
        about_lamps: what a surface ``emitted``, the density with which it would have been drawn, and `make_weight`'s.
    """
    uniform2 = make_sampler(features.sobol)
    rest_of = make_rest(features)
    receiver = make_receiver(features)
    outgoing, scatter, agree, side = about_scattering
    emitted, triangle_pdf, weight = about_lamps
    is_analytic = make_is_analytic(features)
    by_light = features.strategy != "scatter"
    has_lights = features.triangle_lights or features.sphere_lights or features.punctual_lights or features.environment
    glossy = features.kinds != ("diffuse",)
    refracts = "dielectric" in features.kinds or "disney" in features.kinds

    def trace(
        scene: Scene,
        start: wp.vec3,
        toward: wp.vec3,
        time: float,
        settings: Settings,
        stream: sampling.Stream,
        width: wp.vec2,
        wanted: bool,
    ) -> Sample:
        # Where it is not wanted, it is empty: to choose between two samples would copy both.
        sample = Sample()
        origin = start
        direction = toward
        carried = Carried()
        carried.throughput = wp.vec3(1.0, 1.0, 1.0)
        carried.pdf = 1.0
        carried.alone = True
        carried.others = 1.0
        carried.last.position = start
        carried.last.normal = toward
        # What the planes show: the first surface, or the first that is no mirror.
        primary = bool(True)
        tint = wp.vec3(1.0, 1.0, 1.0)
        passed_m = float(0.0)
        # The product of squared relative indices, by which radiance, but not power, was divided on the way.
        eta2 = float(1.0)
        # Of the glass that the ray is in [m⁻¹].
        absorption = wp.vec3()
        # Whether direct light at the last place is analytic.
        analytic = bool(False)
        for depth in range(wp.where(wanted, settings.max_depth, 0)):
            dimension = (depth + 1) * _DIMENSIONS
            if wp.static(features.environment_map and by_light and not primary_only):
                foresee_environment(scene.lights.environment_image, uniform2(stream, dimension + sampling.LIGHT))
            hit = closest(scene, origin, direction, time, stream, depth)
            if wp.static(primary_only):
                sample.boxed = sample.boxed or hit.boxed or hit.sphere >= 0
            if wp.static(features.absorption):
                if hit.triangle >= 0 or hit.sphere >= 0:
                    left = dimmed(absorption, hit.t)
                    carried.throughput = wp.cw_mul(carried.throughput, left)
                    tint = wp.cw_mul(tint, left)
            if wp.static(features.replay):
                note_place(scene.geometry, stream.row, depth, origin, direction, hit)
                sample.places = wp.min(depth + 1, PLACES)
            if hit.triangle < 0:
                sample = ending(scene, sample, hit, origin, direction, time, carried, primary, passed_m)
                if wp.static(primary_only):
                    if not sample.hit:
                        sample.position = origin + direction * MOST_M
                break

            point = face(surface_of(scene.geometry, hit, time), direction)
            choice = uniform2(stream, dimension + sampling.CHOICE)
            goes_on = depth + 1 < settings.max_depth
            normal, bsdf, kept_normal, light = meet(
                scene, point, direction, hit.t, depth, goes_on, stream, choice[0], width, time
            )
            point.shading_normal = normal
            followed = bool(False)
            was_primary = primary
            if primary:
                passed_m += hit.t
                albedo, coat, passing = colours(scene, bsdf, point, kept_normal, direction, tint)
                sample.hit = True
                sample.depth = passed_m
                sample.normal = kept_normal
                if wp.static(features.anchored):
                    sample.instance = hit.instance
                    rest, rest_normal = rest_of(scene.geometry, hit, kept_normal, point.front, time)
                    sample.rest = rest
                    sample.rest_normal = rest_normal
                    if wp.static(not primary_only):
                        sample.met_triangle = hit.triangle
                        sample.weights = wp.vec2(hit.weight0, hit.weight1)
                        sample.toward = direction
                sample.albedo = albedo
                if wp.static(features.coats):
                    sample.coat = coat
                    sample.passing = passing
                    if wp.static(not primary_only):
                        if coat[0] > 0.0:
                            # Half of the paths find what the base sends out, half what the coat reflects.
                            sample.in_coat = (stream.key >> wp.uint64(20)) & wp.uint64(1) == wp.uint64(1)
                            bsdf = one_part(bsdf, sample.in_coat, passing)
                            if sample.in_coat:
                                sample.albedo = coat
                primary = False
                if wp.static(features.follow_specular):
                    followed = bsdf.mirror
                    if wp.static(features.follow_gloss):
                        # Metal seen in gloss is blurred anyway, and rays through both are noisy; but a pane of frosted
                        # glass has two faces.
                        followed = followed or (bsdf.glossy and (bsdf.frosted or not sample.spread))
                    if wp.static(features.blends):
                        followed = followed and scene.materials.rows[point.material].blend_with < 0
                    if wp.static(features.follow_gloss):
                        sample.spread = sample.spread or (followed and bsdf.glossy)
                    primary = followed
                    if wp.static(primary_only and features.stores_hits):
                        sample.bent = sample.bent or followed
            if wp.static(features.triangle_lights):
                radiance = emitted(scene.materials, point)
                if radiance[0] + radiance[1] + radiance[2] > 0.0:
                    drawn = triangle_pdf(scene.lights, hit.instance, hit.triangle, point, direction, carried.last)
                    share = weight(carried.alone, carried.others < 1.0, carried.pdf, drawn)
                    sample.radiance += wp.cw_mul(carried.throughput, radiance) * share
            if wp.static(features.first_hits):
                if was_primary:
                    sample.position = point.position
                    sample.emission = sample.radiance
                    sample.uv = point.uv
                    sample.front = point.front
                    sample.material = wp.where(depth == 0, point.material + 1, 0)
                    alone = depth == 0 and not detailed(scene.materials, point.material)
                    sample.triangle = wp.where(alone, 1 + hit.triangle + hit.instance * 65537, 0)
                if wp.static(features.lamp_light):
                    analytic = was_primary and not primary and is_analytic(scene.materials, bsdf, point.material)
                    if wp.static(features.coats and primary_only):
                        if analytic and coat[0] > 0.0:
                            sample.coated_by = point.material + 1
                            sample.toward = direction
                    sample.lamp = sample.lamp or analytic
                if wp.static(primary_only):
                    if not primary:
                        if wp.static(features.lamp_light):
                            if analytic and goes_on and not bsdf.dark:
                                sample.facing = point.normal
                                sample.reach_m = point.reach_m
                        break
            if not goes_on or bsdf.dark:
                break

            to = receiver(bsdf, point.position, point.shading_normal, -direction)
            draw = choice[0]
            asks = not bsdf.mirror
            if wp.static(features.follow_gloss and not primary_only):
                # What a path finds begins where the pixel ends.
                asks = asks and not followed
            if wp.static(features.lamp_light):
                carried.others = wp.where(analytic, wp.max(scene.lights.environment_probability, NEVER), 1.0)
                if analytic:
                    # The lamps come first, and then the environment.
                    asks = carried.others > NEVER
                    draw = 1.0 - carried.others + draw * carried.others
            out = outgoing(scene.materials, bsdf, point.shading_normal, -direction)
            if wp.static(by_light and has_lights and (features.follow_gloss or not primary_only)):
                if asks:
                    sent = ask(
                        scene, light, point, bsdf, to, out, carried, absorption, draw, stream, dimension, time
                    )  # fmt: skip
                    sample.radiance += sent.radiance
                    if wp.static(primary_only):
                        sample.emission = sample.radiance
                    if wp.static(features.replay):
                        note_light(scene.geometry, stream.row, depth, sent.towards)

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
            carried.pdf = scattered.pdf
            carried.alone = scattered.delta
            throughput = wp.cw_mul(carried.throughput, scattered.weight)
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
            carried.throughput = throughput
            carried.last = to
            origin = offset_origin(point.position, side(point.normal, direction), point.reach_m)
        return sample

    return trace
