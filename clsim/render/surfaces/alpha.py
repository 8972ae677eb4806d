# ruff: noqa: RUF046, SIM102, UP018
"""Rays through cut-out and translucent surfaces and culled backs, as Warp functions.

Rays that carry radiance are stopped by a surface with the probability of its opacity, by numbers of the sample's own
stream, so that pictures of one seed stay the same. Shadow rays are weakened by each surface, which takes no number.
"""

from typing import Any

import warp as wp

from clsim.render.accel.geometry import Geometry, Hit, make_shading_row, step_beyond
from clsim.render.features.features import Features
from clsim.render.sampling.sampling import uniform_of
from clsim.render.surfaces.materials import OPAQUE, Materials

_MOST_LAYERS = wp.constant(256)
"""After as many surfaces on one ray the next one is opaque, so that every ray ends."""


def make_alpha(
    features: Features, closest: Any, surface_of: Any, opacity: Any, chance: Any = uniform_of
) -> tuple[Any, Any]:
    """Return the Warp functions ``pierce`` and ``transmittance``.

    The first gives the nearest hit that stops a ray, the second what is left of a shadow ray, 0 to 1.
    ``chance(word, layer)`` is the number below which opacity stops a ray.
    """
    shading_row = make_shading_row(features)

    @wp.func
    def share(geometry: Geometry, materials: Materials, hit: Hit, time: float) -> float:
        """Return the opacity where a ray hit a triangle."""
        opaque = float(1.0)
        if materials.rows[shading_row(geometry, hit.triangle, 0).material].alpha_mode != OPAQUE:
            opaque = opacity(materials, surface_of(geometry, hit, time))
        return opaque

    @wp.func
    def unseen(geometry: Geometry, materials: Materials, hit: Hit, direction: wp.vec3, time: float) -> bool:
        """Whether a ray meets the back of a surface that is culled."""
        culled = bool(False)
        if materials.rows[shading_row(geometry, hit.triangle, 0).material].culled != 0:
            culled = wp.dot(surface_of(geometry, hit, time).normal, direction) > 0.0
        return culled

    @wp.func
    def past(geometry: Geometry, hit: Hit, direction: wp.vec3, time: float) -> float:
        """Return the way to just behind the surface; counted from a ray's start, so that no error adds up."""
        point = surface_of(geometry, hit, time)
        return hit.t + step_beyond(point.normal, direction, point.reach_m)

    @wp.func
    def pierce(
        geometry: Geometry,
        materials: Materials,
        origin: wp.vec3,
        direction: wp.vec3,
        time: float,
        word: wp.uint64,
        from_camera: bool,
    ) -> Hit:
        hit = closest(geometry, origin, direction, time)
        layer = int(0)
        passed = float(0.0)
        while hit.triangle >= 0 and layer < _MOST_LAYERS:
            opaque = share(geometry, materials, hit, time)
            if wp.static(features.culled_backs):
                if from_camera and unseen(geometry, materials, hit, direction, time):
                    opaque = 0.0
            if opaque >= 1.0 or chance(word, layer) < opaque:
                break
            passed = passed + past(geometry, hit, direction, time)
            hit = closest(geometry, origin + direction * passed, direction, time)
            layer += 1
        hit.t = passed + hit.t
        return hit

    @wp.func
    def transmittance(
        geometry: Geometry, materials: Materials, origin: wp.vec3, direction: wp.vec3, far: float, time: float
    ) -> float:
        left = float(1.0)
        passed = float(0.0)
        for layer in range(_MOST_LAYERS + 1):
            hit = closest(geometry, origin + direction * passed, direction, time)
            if passed + hit.t >= far:
                break
            if hit.triangle < 0 or layer == _MOST_LAYERS:
                left = 0.0
                break
            left = left * (1.0 - share(geometry, materials, hit, time))
            if left <= 0.0:
                break
            passed = passed + past(geometry, hit, direction, time)
        return left

    return pierce, transmittance
