"""All paths of a pixel, one after the other, as a Warp function."""

from typing import Any

import warp as wp

from clsim.render.camera.film import Moments
from clsim.render.sampling import sampling
from clsim.render.sampling.sobol import reverse_bits


def make_gather(
    sobol: bool, shoot: Any, add: Any, merge: Any, scene_type: Any, camera_type: Any, settings_type: Any
) -> Any:
    """Return the Warp function ``gather(scene, camera, settings, pixel, instant)``, which gives a pixel's moments."""

    @wp.func
    def gather(scene: scene_type, camera: camera_type, settings: settings_type, pixel: int, instant: int) -> Moments:
        """Trace all paths of a pixel."""
        state = sampling.absorb(settings.stream, pixel)
        stream = sampling.Stream()
        moments = Moments()
        if wp.static(sobol):
            for batch in range(settings.batches):
                # No sample has a negative number.
                stream.scrambling = sampling.stream_key(sampling.absorb(state, -1 - batch))
                part = Moments()
                for i in range(batch, settings.samples, settings.batches):
                    stream.key = sampling.stream_key(sampling.absorb(state, i))
                    stream.reversed_index = reverse_bits(wp.uint32(i // settings.batches))
                    sample = shoot(scene, camera, settings, pixel, instant, stream)
                    if sampling.finite(sample.radiance) and sampling.finite(sample.normal):
                        part = add(part, sample, settings.spectral)
                moments = merge(moments, part, settings.spectral)
        else:
            for i in range(settings.samples):
                stream.key = sampling.stream_key(sampling.absorb(state, i))
                sample = shoot(scene, camera, settings, pixel, instant, stream)
                # A sample that is not finite is dropped whole, and missing from the plane of sample counts.
                if sampling.finite(sample.radiance) and sampling.finite(sample.normal):
                    moments = add(moments, sample, settings.spectral)
        return moments

    return gather


def make_plain(gather: Any, store: Any, scene_type: Any, view_type: Any, settings_type: Any, options: Any) -> Any:
    """Return the kernel ``render``, of which a thread is a pixel, or one of ``pixels``, with all its paths."""

    @wp.kernel(module="unique", enable_backward=False, module_options=options)
    def render(
        scene: scene_type,
        camera: view_type,
        settings: settings_type,
        first_pixel: int,
        pixels: wp.array[int],
        out_planes: wp.array2d[float],
        out_bits: wp.array2d[wp.uint32],
    ) -> None:
        pixel = first_pixel + wp.tid()
        if pixels.shape[0] > 0:
            pixel = pixels[pixel]
        store(gather(scene, camera, settings, pixel, 0), pixel, out_planes, out_bits)

    return render
