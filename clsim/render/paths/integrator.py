"""The kernel factory: it composes a kernel from the parts that a scene needs; `path.py` is what it does."""

from typing import Any

import warp as wp

from clsim.render.accel.geometry import Hit, Tree
from clsim.render.accel.intersection import make_intersection
from clsim.render.bsdf.bsdf import make_bsdf
from clsim.render.bsdf.coats import make_coats
from clsim.render.camera.camera import CameraState
from clsim.render.camera.film import make_film
from clsim.render.device.compiler import kernel_options, one_at_a_time
from clsim.render.emitters.lights import make_lights, make_side
from clsim.render.features.features import Features
from clsim.render.kernel_input import Scene, Settings
from clsim.render.paths.gather import make_gather, make_plain
from clsim.render.paths.mis import make_weight
from clsim.render.paths.path import make_trace
from clsim.render.paths.path_lights import make_asking, make_ending
from clsim.render.paths.path_surfaces import make_colours, make_detailed, make_meet
from clsim.render.paths.shots import make_shoot, make_shoot_at
from clsim.render.paths.towards_light import make_towards_light
from clsim.render.primary.corners import make_flat_surfaces
from clsim.render.primary.first_hits import make_sample_primary
from clsim.render.primary.lamp_light import make_lamp_light
from clsim.render.primary.shadow_rays import make_shadow_ray
from clsim.render.sampling import sampling
from clsim.render.surfaces.alpha import make_alpha
from clsim.render.surfaces.blends import make_blends
from clsim.render.surfaces.materials import Materials, make_materials
from clsim.render.surfaces.normal_maps import make_normal_maps

_DIMENSIONS = wp.constant(sampling.DIMENSIONS_PER_BOUNCE)


@one_at_a_time
def build_kernel(features: Features, tree: Tree = "warp") -> Any:
    """Return the kernel ``render(scene, camera, settings, first_pixel, pixels, out_planes, out_bits)``.

    A thread is a pixel, or one of ``pixels`` if there are any. ``out_planes`` is float32 ``[C, H·W]`` and ``out_bits``
    the same memory as unsigned integers. With primary rays, it is the kernel of ``steered.py`` or ``cached.py``, and
    for requests one of ``retraced.py``.
    """
    closest, occluded, surface, surface_of = make_intersection(features, tree)
    materials = make_materials(features)
    resolve, emitted, opacity, _, _, lit_sides, textured, coloured, _, mean_texture = materials
    outgoing, scatter_value, scatter, albedo_of = make_bsdf(features)
    mapped_normal = make_normal_maps(features)
    shares, albedos = make_coats(features, albedo_of)
    pick, mean_of_blend = make_blends(features, resolve, albedos)
    pierce, transmittance = make_alpha(features, closest, surface_of, opacity)
    side = make_side(features)

    @wp.func
    def shining(materials: Materials, point: Any) -> wp.vec3:
        """Return what a lamp sends out on average over the rays that its cut-outs stop or let through."""
        radiance = emitted(materials, point)
        if wp.static(features.alpha):
            radiance = radiance * opacity(materials, point)
        return radiance

    sample_light, triangle_pdf, sphere_pdf, environment, on_lamp = make_lights(features, surface, shining)
    add, merge, store = make_film(features.variances, features.sobol)

    @wp.func
    def closest_opaque(
        scene: Scene, origin: wp.vec3, direction: wp.vec3, time: float, stream: sampling.Stream, depth: int
    ) -> Hit:
        if wp.static(features.alpha or features.culled_backs):
            word = sampling.stream_word(stream.key, depth * _DIMENSIONS + sampling.LOBE)
            return pierce(scene.geometry, scene.materials, origin, direction, time, word, depth == 0)
        return closest(scene.geometry, origin, direction, time)

    agree, visibility, look_ahead = make_towards_light(features, occluded, transmittance, sample_light, lit_sides)
    weight = make_weight(features)

    def make_tracer(primary_only: bool) -> Any:
        """Return the function that follows a path, or, if ``primary_only``, its primary ray."""
        return make_trace(
            features,
            primary_only,
            closest_opaque,
            surface_of,
            make_meet(features, primary_only, materials, pick, mapped_normal, look_ahead),
            make_colours(features, albedo_of, shares, mean_of_blend),
            make_detailed(features, textured),
            make_ending(features, sphere_pdf, environment, weight),
            make_asking(features, sample_light, environment, scatter_value, agree, visibility, primary_only),
            (outgoing, scatter, agree, side),
            (emitted, triangle_pdf, weight),
        )

    # Twice: primary rays go without all that paths need. Each is called from one place in a kernel.
    shoot = make_shoot(features.sobol, make_shoot_at(features, wp.func(make_tracer(primary_only=False), inline=True)))
    shoot_primary_at = make_shoot_at(features, wp.func(make_tracer(primary_only=True), inline=True))

    if features.replay:
        from clsim.render.cache.stored_paths import make_replay

        trace = wp.func(make_tracer(primary_only=False), inline=True)
        return make_replay(features, surface, trace, kernel_options())

    flat, mean_albedo = make_flat_surfaces(textured, coloured, mean_texture, albedo_of, features.coats)
    types = Scene, CameraState, Settings
    gather = make_gather(features.sobol, shoot, add, merge, *types)
    mean_albedo = mean_albedo if features.textures else None
    about_light = features.coats, features.shadow_rays, features.stores_hits
    lamps = shadow_ray = None
    if features.lamp_light:
        lamps = make_lamp_light(features, on_lamp, shining)
        shadow_ray = make_shadow_ray(features, sample_light, agree, visibility, on_lamp, shining)
    wide_lamps = features.lamp_light and (features.triangle_lights or features.sphere_lights)
    sample_primary = make_sample_primary(
        features.sobol,
        features.sharp,
        *about_light,
        shoot_primary_at,
        shadow_ray,
        flat,
        mean_albedo,
        lamps,
        wide_lamps,
        *types,
    )
    # Imported where they are needed: Warp reads each function when it is defined.
    if features.requests:
        from clsim.render.paths.retraced import make_retraced

        paths, first_hits, in_cached_light = make_retraced(
            sample_primary, gather, store, wide_lamps, *types, kernel_options()
        )
        if features.light_cache:
            return in_cached_light
        return first_hits if features.first_hits else paths
    if features.first_hits:
        make: Any
        if features.light_cache:
            from clsim.render.cache.cached import make_cached as make
        else:
            from clsim.render.primary.steered import make_steered as make
        about_cache = (
            (features.anchored, features.two_level and not features.motion_blur, features.stores_hits)
            if features.light_cache
            else ()
        )
        return make(features.sobol, *about_cache, sample_primary, shoot, *types, kernel_options())

    return make_plain(gather, store, *types, kernel_options())
