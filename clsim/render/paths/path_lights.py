# ruff: noqa: SIM102
"""Light that a path finds: where it ends on a lamp or in the sky, and by next-event estimation, as Warp functions."""

from typing import Any

import warp as wp

from clsim.render.accel.geometry import Hit, Surface, make_sphere_at
from clsim.render.bsdf.parts import Outgoing
from clsim.render.cache.trails import MOST_M
from clsim.render.camera.film import Sample
from clsim.render.emitters.light_tree import Receiver
from clsim.render.emitters.lights import LightSample
from clsim.render.features.features import Features
from clsim.render.kernel_input import Scene
from clsim.render.paths.towards_light import looks_ahead
from clsim.render.sampling import sampling
from clsim.render.sampling.sobol import make_sampler
from clsim.render.surfaces.absorption import absorption_towards, dimmed
from clsim.render.surfaces.materials import Bsdf


@wp.struct
class Carried:
    """What a path carries to where it goes.

    Attributes:
        throughput: share of light from there that reaches the camera.
        pdf: density of the direction where it was scattered last.
        alone: nothing but scattering finds light from there.
        others: probability with which light other than the lamps' was drawn at the last place; 1 where the lamps' is
            not analytic.
        last: that place.
    """

    throughput: wp.vec3
    pdf: float
    alone: bool
    others: float
    last: Receiver


@wp.struct
class Sent:
    """Direct light that a place reflects.

    Attributes:
        radiance: what reaches the camera of it.
        towards: the place of the light, for a path whose trail is noted.
    """

    radiance: wp.vec3
    towards: wp.vec3


def make_ending(features: Features, sphere_pdf: Any, environment: Any, weight: Any) -> Any:
    """Return the Warp function ``ending``: what a path finds that meets no triangle."""
    sphere_at = make_sphere_at(features)

    @wp.func(inline=True)
    def ending(
        scene: Scene,
        found: Sample,
        hit: Hit,
        origin: wp.vec3,
        direction: wp.vec3,
        time: float,
        carried: Carried,
        primary: bool,
        passed_m: float,
    ) -> Sample:
        """Return the sample with the light of a sphere or the sky, and if the pixel shows it, what its planes tell."""
        sample = found
        met_sphere = False
        if wp.static(features.first_hits):
            if primary:
                sample.triangle = 0
        if wp.static(features.sphere_lights):
            if hit.sphere >= 0:
                met_sphere = True
                drawn = sphere_pdf(scene.lights, scene.geometry, hit.sphere, carried.last, time)
                share = weight(carried.alone, carried.others < 1.0, carried.pdf, drawn)
                radiance = scene.lights.sphere_radiance[hit.sphere]
                sample.radiance += wp.cw_mul(carried.throughput, radiance) * share
                if primary:
                    sphere = sphere_at(scene.geometry, hit.sphere, time)
                    centre = wp.vec3(sphere[0], sphere[1], sphere[2])
                    sample.hit = True
                    sample.depth = passed_m + hit.t
                    sample.albedo = wp.vec3()
                    sample.normal = wp.normalize(origin + direction * hit.t - centre)
                    if wp.static(features.first_hits):
                        sample.position = origin + direction * hit.t
                        sample.instance = -1
                        sample.rest = sample.position
                        sample.rest_normal = sample.normal
                        sample.emission = sample.radiance
        if wp.static(features.environment):
            if not met_sphere:
                sky = environment(scene.lights, carried.last.normal, direction)
                share = weight(carried.alone, False, carried.pdf, sky.pdf / carried.others)
                sample.radiance += wp.cw_mul(carried.throughput, sky.radiance) * share
        if wp.static(features.first_hits):
            if primary and not met_sphere:
                # A mirror that shows the sky shines like it: no light is looked up there, nor what of it changed.
                sample.hit = False
                sample.emission = sample.radiance
        return sample

    return ending


def make_asking(
    features: Features,
    sample_light: Any,
    environment: Any,
    scatter_value: Any,
    agree: Any,
    visibility: Any,
    primary_only: bool,
) -> Any:
    """Return the Warp function ``ask``: light that a place sends on towards the path, straight from a light."""
    uniform2 = make_sampler(features.sobol)
    ahead = looks_ahead(features) and not primary_only
    by_scatter = features.strategy != "light"

    @wp.func(inline=True)
    def ask(
        scene: Scene,
        foreseen: LightSample,
        point: Surface,
        bsdf: Bsdf,
        to: Receiver,
        out: Outgoing,
        carried: Carried,
        absorption: wp.vec3,
        draw: float,
        stream: sampling.Stream,
        dimension: int,
        time: float,
    ) -> Sent:
        """Return that light; ``foreseen`` was asked before, where lights come first."""
        sent = Sent()
        light = foreseen
        if wp.static(not ahead):
            u = uniform2(stream, dimension + sampling.LIGHT)
            finer = sampling.uniform_of(sampling.stream_word(stream.key, dimension + sampling.CHOICE), 0)
            light = sample_light(scene.lights, scene.geometry, scene.materials, point, to, draw, finer, u, time)
        if wp.static(features.lamp_light):
            light.pdf = light.pdf / carried.others
        if light.pdf > 0.0 and agree(point, light.direction):
            scattering = scatter_value(scene.materials, bsdf, point.shading_normal, out, light.direction)
            value = wp.cw_mul(wp.cw_mul(carried.throughput, light.radiance), scattering.value)
            if value[0] + value[1] + value[2] > 0.0:
                if wp.static(features.replay):
                    sent.towards = light.origin + light.direction * wp.min(light.distance, MOST_M)
                if wp.static(not ahead):
                    light.visible = visibility(scene, light.origin, light.direction, light.distance, time)
                if light.visible > 0.0:
                    w = light.visible
                    if wp.static(features.environment_map):
                        if light.mapped:
                            sky = environment(scene.lights, point.shading_normal, light.direction)
                            value = wp.cw_mul(value, sky.radiance)
                            # Next to a cell that is black, roundings may end in it.
                            light.pdf = wp.max(sky.pdf / carried.others, 1.0e-30)
                    if wp.static(features.absorption):
                        way = absorption_towards(scene.materials, point, light.direction, absorption)
                        value = wp.cw_mul(value, dimmed(way, light.distance))
                    if wp.static(by_scatter):
                        if not light.delta:
                            w = w * sampling.power_heuristic(light.pdf, scattering.pdf)
                    sent.radiance = value * (w / light.pdf)
        return sent

    return ask
