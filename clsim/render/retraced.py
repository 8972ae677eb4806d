# Warp: a variable that changes must be born by a call.
"""The kernels that trace chosen pixels at chosen times, with the random numbers that these pixels have in every frame.

So a pixel has the same bits at the same time, whether a frame or a request asked for it.
"""

from typing import Any

import warp as wp

from clsim.frames import rendered_planes
from clsim.render import sampling
from clsim.render.film import store3
from clsim.render.sampling import luminance
from clsim.render.sobol import reverse_bits
from clsim.render.steered import FirstHits, see, store_surfaces

_PLANES = rendered_planes(first_hit_rays=True)
_FIRST = {plane.name: _PLANES.first(plane.name) for plane in _PLANES.planes}


def make_retraced(
    sobol: bool, shoot: Any, gather: Any, store: Any, scene_type: Any, view_type: Any, settings_type: Any, options: Any
) -> tuple[Any, Any]:
    """Return two kernels, of which a thread is a request: all paths of the pixel, or its first-hit rays alone.

    ``pixels`` and ``instants``, int32 ``[N]``, tell the pixel (y·width + x) and the instant of each request;
    ``out_planes``, float32 ``[C, N]``, is as for frames, and ``out_bits`` the same memory as unsigned integers. Of
    first-hit rays alone, the plane of radiance is that of emission, and ``settings.samples`` is how many there are at
    most, ``first_look`` at least.
    """

    @wp.kernel(module="unique", enable_backward=False, module_options=options)
    def retrace_paths(
        scene: scene_type,
        camera: view_type,
        settings: settings_type,
        first: int,
        pixels: wp.array(dtype=int),
        instants: wp.array(dtype=int),
        out_planes: wp.array2d(dtype=float),
        out_bits: wp.array2d(dtype=wp.uint32),
    ):
        request = first + wp.tid()
        moments = gather(scene, camera, settings, pixels[request], instants[request])
        store(moments, request, out_planes, out_bits)

    @wp.kernel(module="unique", enable_backward=False, module_options=options)
    def retrace_first_hits(
        scene: scene_type,
        camera: view_type,
        settings: settings_type,
        first: int,
        first_look: int,
        pixels: wp.array(dtype=int),
        instants: wp.array(dtype=int),
        out_planes: wp.array2d(dtype=float),
    ):
        request = first + wp.tid()
        pixel = pixels[request]
        state = sampling.absorb(settings.stream, pixel)
        stream = sampling.Stream()
        seen = FirstHits()
        if wp.static(sobol):
            stream.scrambling = sampling.stream_key(sampling.absorb(state, -1))
        for i in range(settings.samples):
            if i < first_look or seen.spread > 1.0:
                if wp.static(sobol):
                    stream.reversed_index = reverse_bits(wp.uint32(i))
                stream.key = sampling.stream_key(sampling.absorb(state, i))
                sample = shoot(scene, camera, settings, pixel, instants[request], stream, True)
                # A sample that is not finite is dropped whole.
                if sampling.finite(sample.normal) and sampling.finite(sample.emission):
                    seen = see(seen, sample)
        count = wp.max(seen.count, 1.0)
        emission = seen.emission / count
        store_surfaces(seen, request, out_planes)
        store3(out_planes, wp.static(_FIRST["Radiance"]), request, emission)
        out_planes[wp.static(_FIRST["Coverage"]), request] = seen.hits / count
        out_planes[wp.static(_FIRST["Samples"]), request] = seen.count
        out_planes[wp.static(_FIRST["Emission"]), request] = luminance(emission)

    return retrace_paths, retrace_first_hits
