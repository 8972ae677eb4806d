"""The film: means and variances of the mean of a pixel's samples, as Warp functions.

Box filter: a sample counts for the pixel it falls in. Running moments by Welford's recurrence (Technometrics 4(3),
1962), which stays honest in float32 where sums of squares would cancel.
"""

from typing import Any

import warp as wp

from clsim.frames import rendered_planes
from clsim.render.sampling.sampling import brightness


@wp.struct
class Sample:
    """A sample: what one camera ray saw; the features are those of the first hit.

    ``emission`` is the part of the radiance that the first hit, or the sky behind it all, shines by itself; it is
    filled in where there are primary rays, and so is ``position``, where the features are. There ``uv`` and
    ``front`` tell where on its surface that is; ``material`` is its number from 1, and ``triangle`` tells the triangle
    from others, both 0 where a mirror showed it.

    ``coat`` is the albedo of a coat whose light is cached separately, and ``albedo`` then that of what lies below; over
    its colour, that is ``passing``. Of a path, ``in_coat`` is whether it found what the coat reflects, and so has
    ``coat`` for its albedo.

    ``lamp`` is whether direct light is analytic (``lamp_light.py``); under a coat, ``coated_by`` is the number of its
    material from 1. A shadow ray to a place on a lamp carries ``lamp_all`` if nothing stands between, else
    ``lamp_lit``; of that the coat reflects ``coat_all``, or ``coat_lit``. ``boxed`` is whether the first ray went into
    the box around an instance, or met a lamp; ``bent``, whether a mirror, gloss or glass sent it on, and ``spread``,
    whether gloss did. Where what pixels saw is stored, ``position`` of the sky is far away.

    Where cells lie on what moves, ``instance`` is what was hit, −1 for none; ``rest`` and ``rest_normal`` are where
    that place is, and its normal, while the instance rests. Of a path, ``met_triangle`` and ``weights``
    tell that place too; ``places`` are those of its trail. ``toward`` is the direction in which it was met, also of a
    primary ray that met a coat.
    """

    radiance: wp.vec3
    emission: wp.vec3
    albedo: wp.vec3
    normal: wp.vec3
    position: wp.vec3
    depth: float
    uv: wp.vec2
    material: int
    triangle: int
    coat: wp.vec3
    passing: float
    coated_by: int
    lamp_all: float
    lamp_lit: float
    coat_all: float
    coat_lit: float
    instance: int
    rest: wp.vec3
    rest_normal: wp.vec3
    met_triangle: int
    weights: wp.vec2
    toward: wp.vec3
    places: int
    facing: wp.vec3
    reach_m: float
    # Together, so that a copy has no gaps.
    hit: bool
    front: bool
    in_coat: bool
    lamp: bool
    boxed: bool
    bent: bool
    spread: bool


@wp.struct
class Moments:
    """Means and sums of squared deviations of a pixel; radiance over all samples, features over those that hit.

    ``batches`` and ``hit_batches`` count the batches with any such samples, ``covered`` is the share of those that hit.
    """

    count: float
    hits: float
    batches: float
    hit_batches: float
    covered: float
    covered_m2: float
    radiance: wp.vec3
    radiance_m2: wp.vec3
    luminance: float
    luminance_m2: float
    albedo: wp.vec3
    albedo_m2: wp.vec3
    normal: wp.vec3
    normal_m2: wp.vec3
    depth: float
    depth_m2: float


_NAN_BITS = wp.constant(wp.uint32(0x7FC00000))


@wp.func
def store3(out: wp.array2d[float], plane: int, pixel: int, value: wp.vec3) -> None:
    """Store a vector in three planes, one after the other."""
    out[plane, pixel] = value[0]
    out[plane + 1, pixel] = value[1]
    out[plane + 2, pixel] = value[2]


@wp.func
def _unknown(out_bits: wp.array2d[wp.uint32], plane: int, width: int, pixel: int) -> None:
    """Store NaN by its bits: the kernel is compiled as if there were no NaN."""
    for i in range(width):
        out_bits[plane + i, pixel] = _NAN_BITS


def make_film(variances: bool, batched: bool) -> tuple[Any, Any, Any]:
    """Return the Warp functions ``add(moments, sample, weights)``, ``merge`` and ``store``.

    Where samples are ``batched``, those within a batch depend on each other: each batch is added up by itself, and
    ``merge(moments, batch)`` adds its means as if they were samples, weighted by their numbers of samples.
    """
    planes = rendered_planes(variances=variances)
    first = {plane.name: planes.first(plane.name) for plane in planes.planes}
    spread = {plane.name: planes.first_variance(plane.name) for plane in planes.with_variance}

    @wp.func
    def merge(moments: Moments, batch: Moments, weights: wp.vec3) -> Moments:
        m = moments
        if batch.count > 0.0:
            m.batches = m.batches + 1.0
            m.count = m.count + batch.count
            share = batch.count / m.count
            delta = batch.radiance - m.radiance
            m.radiance = m.radiance + delta * share
            covered = batch.hits / batch.count
            covered_delta = covered - m.covered
            m.covered = m.covered + covered_delta * share
            if wp.static(variances):
                m.radiance_m2 = m.radiance_m2 + wp.cw_mul(delta, batch.radiance - m.radiance) * batch.count
                y = brightness(batch.radiance, weights)
                y_delta = y - m.luminance
                m.luminance = m.luminance + y_delta * share
                m.luminance_m2 = m.luminance_m2 + y_delta * (y - m.luminance) * batch.count
                m.covered_m2 = m.covered_m2 + covered_delta * (covered - m.covered) * batch.count
        if batch.hits > 0.0:
            m.hit_batches = m.hit_batches + 1.0
            m.hits = m.hits + batch.hits
            share = batch.hits / m.hits
            albedo_delta = batch.albedo - m.albedo
            normal_delta = batch.normal - m.normal
            depth_delta = batch.depth - m.depth
            m.albedo = m.albedo + albedo_delta * share
            m.normal = m.normal + normal_delta * share
            m.depth = m.depth + depth_delta * share
            if wp.static(variances):
                m.albedo_m2 = m.albedo_m2 + wp.cw_mul(albedo_delta, batch.albedo - m.albedo) * batch.hits
                m.normal_m2 = m.normal_m2 + wp.cw_mul(normal_delta, batch.normal - m.normal) * batch.hits
                m.depth_m2 = m.depth_m2 + depth_delta * (batch.depth - m.depth) * batch.hits
        return m

    @wp.func
    def add(moments: Moments, sample: Sample, weights: wp.vec3) -> Moments:
        m = moments
        m.count = m.count + 1.0
        delta = sample.radiance - m.radiance
        m.radiance = m.radiance + delta / m.count
        if wp.static(variances and not batched):
            m.radiance_m2 = m.radiance_m2 + wp.cw_mul(delta, sample.radiance - m.radiance)
            y = brightness(sample.radiance, weights)
            y_delta = y - m.luminance
            m.luminance = m.luminance + y_delta / m.count
            m.luminance_m2 = m.luminance_m2 + y_delta * (y - m.luminance)
        if sample.hit:
            m.hits = m.hits + 1.0
            albedo_delta = sample.albedo - m.albedo
            normal_delta = sample.normal - m.normal
            depth_delta = sample.depth - m.depth
            m.albedo = m.albedo + albedo_delta / m.hits
            m.normal = m.normal + normal_delta / m.hits
            m.depth = m.depth + depth_delta / m.hits
            if wp.static(variances and not batched):
                m.albedo_m2 = m.albedo_m2 + wp.cw_mul(albedo_delta, sample.albedo - m.albedo)
                m.normal_m2 = m.normal_m2 + wp.cw_mul(normal_delta, sample.normal - m.normal)
                m.depth_m2 = m.depth_m2 + depth_delta * (sample.depth - m.depth)
        return m

    @wp.func
    def store(moments: Moments, pixel: int, out_planes: wp.array2d[float], out_bits: wp.array2d[wp.uint32]) -> None:
        """Planes where the table of planes has them."""
        coverage = moments.hits / wp.max(moments.count, 1.0)
        store3(out_planes, wp.static(first["Radiance"]), pixel, moments.radiance)
        store3(out_planes, wp.static(first["Albedo"]), pixel, moments.albedo)
        store3(out_planes, wp.static(first["Normal"]), pixel, moments.normal)
        out_planes[wp.static(first["Depth"]), pixel] = moments.depth
        out_planes[wp.static(first["Coverage"]), pixel] = coverage
        out_planes[wp.static(first["Samples"]), pixel] = moments.count
        if wp.static(variances):
            parts = moments.count
            hit_parts = moments.hits
            coverage_m2 = moments.hits * (1.0 - coverage)
            if wp.static(batched):
                parts = moments.batches
                hit_parts = moments.hit_batches
                coverage_m2 = moments.covered_m2
            if parts < 2.0:
                _unknown(out_bits, wp.static(spread["Radiance"]), 3, pixel)
                _unknown(out_bits, wp.static(spread["Coverage"]), 1, pixel)
                _unknown(out_bits, wp.static(spread["Luminance"]), 1, pixel)
            else:
                scale = 1.0 / (moments.count * (parts - 1.0))
                store3(out_planes, wp.static(spread["Radiance"]), pixel, moments.radiance_m2 * scale)
                out_planes[wp.static(spread["Coverage"]), pixel] = coverage_m2 * scale
                out_planes[wp.static(spread["Luminance"]), pixel] = moments.luminance_m2 * scale
            if hit_parts < 2.0:
                _unknown(out_bits, wp.static(spread["Albedo"]), 3, pixel)
                _unknown(out_bits, wp.static(spread["Normal"]), 3, pixel)
                _unknown(out_bits, wp.static(spread["Depth"]), 1, pixel)
            else:
                scale = 1.0 / (moments.hits * (hit_parts - 1.0))
                store3(out_planes, wp.static(spread["Albedo"]), pixel, moments.albedo_m2 * scale)
                store3(out_planes, wp.static(spread["Normal"]), pixel, moments.normal_m2 * scale)
                out_planes[wp.static(spread["Depth"]), pixel] = moments.depth_m2 * scale

    return add, merge, store
