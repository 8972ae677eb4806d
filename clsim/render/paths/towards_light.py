# ruff: noqa: SIM102
"""The way from a point to a light: whether light passes there, and shadow rays that go before textures are read.

A texel takes as long to come from memory as a ray takes. So where there are image textures, texels are asked for, then
the ray goes to the light, and then they are read.
"""

from typing import Any

import warp as wp

from clsim.render.accel.geometry import CLEAR, PERHAPS, Surface
from clsim.render.emitters.light_tree import Receiver
from clsim.render.emitters.lights import LightSample
from clsim.render.features.features import Features
from clsim.render.kernel_input import Scene
from clsim.render.sampling import sampling
from clsim.render.sampling.sobol import make_sampler


def looks_ahead(features: Features) -> bool:
    """Whether the kernel's rays to lights go before textures are read.

    A light tree needs the surface's reflectance, which its textures tell, and so does analytic direct light.
    """
    asks = features.lamp_light or (features.light_tree and features.kinds != ("diffuse",))
    return features.strategy != "scatter" and features.images and not asks


def make_towards_light(
    features: Features, occluded: Any, transmittance: Any, sample_light: Any, lit_sides: Any
) -> tuple[Any, Any, Any]:
    """Return the Warp functions ``agree``, ``visibility`` and ``look_ahead``.

    The last one gives a light, as ``sample_light`` draws it, and what of it is ``visible``. ``lit_sides`` is
    that of `make_materials`.
    """
    uniform2 = make_sampler(features.sobol)

    @wp.func
    def visibility(scene: Scene, origin: wp.vec3, direction: wp.vec3, far: float, time: float) -> float:
        found = occluded(scene.geometry, origin, direction, far, time)
        left = wp.where(found == CLEAR, 1.0, 0.0)
        if wp.static(features.alpha):
            if found == PERHAPS:
                left = transmittance(scene.geometry, scene.materials, origin, direction, far, time)
        return left

    @wp.func
    def agree(point: Surface, toward: wp.vec3) -> bool:
        """Whether a direction is on the same side of the triangle and of the shading normal: light must not leak."""
        flat = wp.dot(toward, point.normal)
        good = flat > 0.0
        if wp.static(features.transmission):
            good = flat * wp.dot(toward, point.shading_normal) > 0.0
        return good

    @wp.func
    def look_ahead(
        scene: Scene, point: Surface, stream: sampling.Stream, dimension: int, choice: float, time: float
    ) -> LightSample:
        light = LightSample()
        sides = lit_sides(scene.materials, point)
        if sides > 0:
            to = Receiver()
            to.position = point.position
            to.normal = point.shading_normal
            u = uniform2(stream, dimension + sampling.LIGHT)
            finer = sampling.uniform_of(sampling.stream_word(stream.key, dimension + sampling.CHOICE), 0)
            light = sample_light(scene.lights, scene.geometry, scene.materials, point, to, choice, finer, u, time)
            sent = light.radiance[0] + light.radiance[1] + light.radiance[2]
            if light.pdf > 0.0 and sent > 0.0 and agree(point, light.direction):
                if sides > 1 or wp.dot(light.direction, point.shading_normal) > 0.0:
                    light.visible = visibility(scene, light.origin, light.direction, light.distance, time)
        return light

    return agree, visibility, look_ahead
