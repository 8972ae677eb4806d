"""Glass that dims light on its way within, as Warp functions.

A path knows how much light dims where it is. That changes where it crosses the surface of solid glass: inside it is the
glass's, outside nothing. Panes and cut-outs have no inside.
"""

import warp as wp

from clsim.render.accel.geometry import Surface
from clsim.render.features.bsdf_kinds import DIELECTRIC, DISNEY
from clsim.render.surfaces.materials import Materials


@wp.func
def absorption_towards(materials: Materials, point: Surface, direction: wp.vec3, here: wp.vec3) -> wp.vec3:
    """Return the absorption [m⁻¹] on the way in a direction; ``here`` is that on the side where the ray came from."""
    absorption = here
    row = materials.rows[point.material]
    if wp.dot(point.normal, direction) < 0.0 and (row.kind == DIELECTRIC or row.kind == DISNEY):
        absorption = wp.where(point.front, row.absorption, wp.vec3())
    return absorption


@wp.func
def dimmed(absorption: wp.vec3, way_m: float) -> wp.vec3:
    """Return what is left of light after a way (Beer's law); light from infinity comes through what is clear."""
    far = wp.min(way_m, 1.0e30)
    return wp.vec3(wp.exp(-absorption[0] * far), wp.exp(-absorption[1] * far), wp.exp(-absorption[2] * far))
