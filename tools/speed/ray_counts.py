"""How many rays a path takes in a scene: the rays that the renderer's own kernel searches are counted."""

import contextlib
import ctypes
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any
from unittest.mock import patch

import warp as wp

from clsim.frames import Frame, page_aligned
from clsim.render import PathTracer, RenderOptions
from clsim.render.accel.geometry import Geometry, Hit, Tree
from clsim.render.accel.intersection import make_intersection
from clsim.render.features.features import Features
from clsim.render.paths.integrator import build_kernel
from clsim.render.surfaces.alpha import make_alpha
from clsim.scene import World

_SPP = 4
_SIZE = (64, 48)
_FRAMES = 3


@dataclass(frozen=True)
class RaysPerPath:
    """Rays that a path takes on average, by kind.

    Attributes:
        primary: from the camera: 1.
        bounce: on from a surface, and on from what is cut out or translucent, behind which a ray starts anew.
        shadow: to a light, likewise.
    """

    primary: float
    bounce: float
    shadow: float

    @property
    def total(self) -> float:
        """Rays of all kinds."""
        return self.primary + self.bounce + self.shadow


def rays_per_path(world: World, options: RenderOptions) -> RaysPerPath:
    """Count the rays of a few frames spread over ``options.frames``, in a small picture on the CPU."""
    width, height = _SIZE
    small = replace(world, camera=replace(world.camera, width=width, height=height))
    counts = (ctypes.c_ulonglong * 2)()
    with _counting(counts):
        # With common noise a picture in which nothing has moved would not be rendered again.
        tracer = PathTracer(small, replace(options, spp=_SPP, device="cpu", variances=False, noise="independent"))
        try:
            frame = Frame(page_aligned((len(tracer.names), height, width)), tracer.names)
            last = (tracer.frame_count or 1) - 1
            frames = sorted({last * i // (_FRAMES - 1) for i in range(_FRAMES)})
            for index in frames:
                tracer.fill(index, frame)
        finally:
            tracer.close()
    paths = width * height * _SPP * len(frames)
    nearest, any_hit = counts[0] / paths, counts[1] / paths
    primary = min(nearest, 1.0)  # a lens may leave pixels dark
    return RaysPerPath(primary, nearest - primary, any_hit)


@contextlib.contextmanager
def _counting(counts: ctypes.Array[ctypes.c_ulonglong]) -> Iterator[None]:
    """Have kernels built meanwhile count in ``counts[0]`` the searches of paths, in ``counts[1]`` those toward lights.

    The place of the counts in memory is built into the kernel, so none of these may be kept for later.
    """

    toward_light: Any = None

    def counted_intersection(features: Features, tree: Tree) -> Any:
        nonlocal toward_light
        functions, toward_light = count_searches(make_intersection(features, tree), ctypes.addressof(counts))
        return functions

    def counted_alpha(features: Features, closest: Any, surface_of: Any, opacity: Any) -> tuple[Any, Any]:
        pierce, _ = make_alpha(features, closest, surface_of, opacity)
        _, transmittance = make_alpha(features, toward_light, surface_of, opacity)
        return pierce, transmittance

    build_kernel.cache_clear()
    try:
        with (
            patch("clsim.render.paths.integrator.make_intersection", counted_intersection),
            patch("clsim.render.paths.integrator.make_alpha", counted_alpha),
        ):
            yield
    finally:
        build_kernel.cache_clear()


def count_searches(functions: tuple[Any, Any, Any, Any], address: int) -> tuple[tuple[Any, Any, Any, Any], Any]:
    """Return what ``make_intersection`` gave, so that it counts: on CPUs, in two 64-bit integers at ``address``.

    The first one counts searches for the nearest hit, the second one for any hit. What is returned beside them searches
    for the nearest hit on the way to a light, and counts in the second one.
    """
    closest, occluded, surface, surface_of = functions

    @wp.func_native(f"__atomic_fetch_add((unsigned long long*){address:#x}ull + which, 1ull, 0);")
    def count(which: int): ...

    @wp.func
    def counted_closest(geometry: Geometry, origin: wp.vec3, direction: wp.vec3, time: float) -> Hit:
        count(0)
        return closest(geometry, origin, direction, time)

    @wp.func
    def counted_toward_light(geometry: Geometry, origin: wp.vec3, direction: wp.vec3, time: float) -> Hit:
        count(1)
        return closest(geometry, origin, direction, time)

    @wp.func
    def counted_occluded(geometry: Geometry, origin: wp.vec3, direction: wp.vec3, far: float, time: float) -> int:
        count(1)
        return occluded(geometry, origin, direction, far, time)

    return (counted_closest, counted_occluded, surface, surface_of), counted_toward_light
