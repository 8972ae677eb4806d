"""Lambert's diffuse surfaces, as Warp functions; directions are those of the world."""

import warp as wp

from clsim.render.bsdf.parts import Scattered, Scattering
from clsim.render.sampling.sampling import cosine_hemisphere
from clsim.render.surfaces.materials import Bsdf


@wp.func
def diffuse_value(b: Bsdf, normal: wp.vec3, wi: wp.vec3) -> Scattering:
    """Return f·cos θ and density."""
    cosine = wp.max(wp.dot(normal, wi), 0.0) / wp.pi
    return Scattering(b.color * cosine, cosine)  # type: ignore[call-arg]


@wp.func
def diffuse_sample(b: Bsdf, normal: wp.vec3, u: wp.vec2) -> Scattered:
    """Draw a direction by the cosine, so that the weight is the reflectance."""
    s = Scattered()
    s.eta2 = 1.0
    s.direction = cosine_hemisphere(normal, u)
    s.pdf = wp.max(wp.dot(normal, s.direction), 0.0) / wp.pi
    s.weight = b.color
    return s
