"""Warp kernels that search rays and nothing else."""

from typing import Any

import warp as wp

from clsim.render.accel.geometry import Geometry, Tree
from clsim.render.accel.intersection import face, make_intersection
from clsim.render.camera.camera import CameraState
from clsim.render.device.compiler import kernel_options
from clsim.render.features.features import Features


@wp.kernel(enable_backward=False)
def aim(camera: CameraState, width: int, out_origins: wp.array[wp.vec3], out_directions: wp.array[wp.vec3]) -> None:
    """Write rays of a plain pinhole through the centres of pixels."""
    i = wp.tid()
    out_origins[i] = camera.origin
    x, y = float(i % width) + 0.5, float(i // width) + 0.5
    out_directions[i] = wp.normalize(camera.corner + camera.right * x + camera.down * y)


def build_searches(features: Features, tree: Tree) -> tuple[Any, Any, Any]:
    """Return kernels for the nearest hit, for any hit nearer than 1, and for the places and normals of hits."""
    closest, occluded, _, surface_of = make_intersection(features, tree)

    @wp.kernel(module="unique", enable_backward=False, module_options=kernel_options())
    def nearest(
        geometry: Geometry,
        origins: wp.array[wp.vec3],
        directions: wp.array[wp.vec3],
        out_t: wp.array[float],
        out_triangle: wp.array[int],
    ) -> None:
        i = wp.tid()
        hit = closest(geometry, origins[i], directions[i], 0.0)
        out_t[i] = hit.t
        out_triangle[i] = hit.triangle

    @wp.kernel(module="unique", enable_backward=False, module_options=kernel_options())
    def shadow(
        geometry: Geometry,
        origins: wp.array[wp.vec3],
        directions: wp.array[wp.vec3],
        out_hidden: wp.array[int],
    ) -> None:
        i = wp.tid()
        out_hidden[i] = int(occluded(geometry, origins[i], directions[i], 1.0, 0.0))

    @wp.kernel(module="unique", enable_backward=False, module_options=kernel_options())
    def places(
        geometry: Geometry,
        origins: wp.array[wp.vec3],
        directions: wp.array[wp.vec3],
        out_place: wp.array[wp.vec3],
        out_normal: wp.array[wp.vec3],
    ) -> None:
        i = wp.tid()
        hit = closest(geometry, origins[i], directions[i], 0.0)
        if hit.triangle >= 0:
            point = face(surface_of(geometry, hit, 0.0), directions[i])
            out_place[i] = point.position
            out_normal[i] = point.normal

    return nearest, shadow, places
