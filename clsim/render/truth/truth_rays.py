# ruff: noqa: RUF046, SIM102, UP018
"""The kernels of truth: what the middle of each pixel shows, and where that goes.

``trace_centres`` traces a ray through each pixel's centre and stores what it met. ``follow`` runs when the scene and
the camera have been moved to another time: it finds the same points there, projects them, and asks whether the camera
sees them.
"""

from dataclasses import replace
from typing import Any

import warp as wp

from clsim.frames.planes import PlaneSet
from clsim.render.accel.geometry import Geometry, Hit, Tree, make_sphere_at, xyz
from clsim.render.accel.intersection import face, make_intersection
from clsim.render.bsdf.bsdf import make_bsdf
from clsim.render.camera.camera import CameraState, make_camera, make_projection
from clsim.render.device.compiler import kernel_options, one_at_a_time
from clsim.render.features.features import Features
from clsim.render.kernel_input import Scene
from clsim.render.surfaces.alpha import make_alpha
from clsim.render.surfaces.blends import make_blends
from clsim.render.surfaces.materials import make_materials
from clsim.render.surfaces.normal_maps import make_normal_maps

UNSEEN, SKY, TRIANGLE, SPHERE = (wp.constant(n) for n in range(4))
_NOW = wp.constant(0.5)
"""The instant to which a scene is moved, as a share of the interval that its data covers."""
_NEARER = wp.constant(1.0 - 1.0e-4)
"""What hides a point is nearer than this share of the way to it."""


@wp.struct
class TruthHit:
    """What a pixel's centre shows.

    ``anchor`` is the point from a sphere's centre, or the way to the sky; ``place`` the image position of the point as
    the projection gives it, so that its error cancels in the difference to that at another time.
    """

    kind: int
    instance: int
    triangle: int
    sphere: int
    weight0: float
    weight1: float
    anchor: wp.vec3
    place: wp.vec2


@wp.struct
class Objects:
    """Which object a hit belongs to; see ``Placement``. Sphere lights come after ``count`` instances."""

    of_instance: wp.array[int]
    of_triangle: wp.array[int]
    count: int


@wp.func
def _even_odds(word: wp.uint64, layer: int) -> float:
    """Return the opacity from which on truth takes a surface for solid."""
    return 0.5


@one_at_a_time
def build_truth(features: Features, planes: PlaneSet, tree: Tree) -> tuple[Any, Any]:
    """Return the kernels ``trace_centres`` and ``follow``; a thread is a pixel, and ``out_planes`` is ``[C, H·W]``.

    ``planes`` holds truth alone, and says which rows of ``out_planes`` are which.
    """
    first = {plane.name: planes.first(plane.name) for plane in planes.truth}
    closest, _, surface, surface_of = make_intersection(features, tree)
    sphere_at = make_sphere_at(features)
    resolve, _, opacity, *_ = make_materials(features)
    *_, albedo_of = make_bsdf(features)

    @wp.func
    def albedos(materials: Any, bsdf: Any, cosine: float) -> wp.vec4:
        color = albedo_of(bsdf)
        return wp.vec4(color[0], color[1], color[2], 0.0)

    _, mean_of_blend = make_blends(features, resolve, albedos)
    mapped_normal = make_normal_maps(features)
    pierce, _ = make_alpha(features, closest, surface_of, opacity, _even_odds)
    camera_ray = make_camera(features)
    project = make_projection(features)
    parallel = features.projection == "orthographic"

    @wp.func
    def solid(scene: Scene, origin: wp.vec3, direction: wp.vec3) -> Hit:
        if wp.static(features.alpha or features.culled_backs):
            return pierce(scene.geometry, scene.materials, origin, direction, _NOW, wp.uint64(0), True)
        return closest(scene.geometry, origin, direction, _NOW)

    @wp.func
    def centre_of(geometry: Geometry, sphere: int) -> wp.vec3:
        return xyz(sphere_at(geometry, sphere, _NOW))

    @wp.func
    def put3(out_planes: wp.array2d[float], row: int, pixel: int, value: wp.vec3) -> None:
        out_planes[row, pixel] = value[0]
        out_planes[row + 1, pixel] = value[1]
        out_planes[row + 2, pixel] = value[2]

    @wp.kernel(module="unique", enable_backward=False, module_options=kernel_options())
    def trace_centres(
        scene: Scene,
        camera: CameraState,
        objects: Objects,
        width: int,
        first_pixel: int,
        out_hits: wp.array[TruthHit],
        out_planes: wp.array2d[float],
    ) -> None:
        pixel = first_pixel + wp.tid()
        x = float(pixel % width) + 0.5
        y = float(pixel // width) + 0.5
        ray = camera_ray(camera, x, y, wp.vec2(), 0.0)
        seen = TruthHit()
        seen.kind = UNSEEN
        way = ray.direction
        normal = wp.vec3()
        albedo = wp.vec3()
        number = int(0)
        material = int(0)
        z = float(wp.inf)
        distance = float(wp.inf)
        if ray.exists:
            hit = solid(scene, ray.origin, ray.direction)
            if hit.triangle >= 0:
                point = face(surface_of(scene.geometry, hit, _NOW), ray.direction)
                way = point.position - ray.origin
                seen.kind = TRIANGLE
                seen.instance = hit.instance
                seen.triangle = hit.triangle
                seen.weight0 = hit.weight0
                seen.weight1 = hit.weight1
                number = 1 + objects.of_instance[hit.instance]
                if number == 0:
                    number = 1 + objects.of_triangle[hit.triangle]
                material = 1 + point.material
                normal = point.shading_normal
                if wp.static("Truth.Normal" in first and features.normal_maps):
                    normal = mapped_normal(scene.materials, point, -ray.direction)
                if wp.static("Truth.Albedo" in first):
                    albedo = albedo_of(resolve(scene.materials, point))
                    if wp.static(features.blends):
                        mean = mean_of_blend(scene.materials, point, 1.0)
                        albedo = wp.vec3(mean[0], mean[1], mean[2])
            elif hit.sphere >= 0:
                way = ray.direction * hit.t
                seen.kind = SPHERE
                seen.sphere = hit.sphere
                seen.anchor = ray.origin + way - centre_of(scene.geometry, hit.sphere)
                number = 1 + objects.count + hit.sphere
                normal = wp.normalize(seen.anchor)
            else:
                seen.kind = SKY
                seen.anchor = ray.direction
            if seen.kind == TRIANGLE or seen.kind == SPHERE:
                distance = wp.length(way)
                z = wp.dot(way, wp.quat_rotate(camera.rotations[0], wp.vec3(0.0, 0.0, -1.0)))
        place = project(camera, way + ray.origin - camera.positions[0], 0)
        seen.place = wp.vec2(place[0], place[1])
        out_hits[pixel] = seen
        if wp.static("Z" in first):
            out_planes[wp.static(first.get("Z", 0)), pixel] = z
        if wp.static("Truth.Depth" in first):
            out_planes[wp.static(first.get("Truth.Depth", 0)), pixel] = distance
        if wp.static("Truth.Normal" in first):
            put3(out_planes, wp.static(first.get("Truth.Normal", 0)), pixel, normal)
        if wp.static("Truth.Albedo" in first):
            put3(out_planes, wp.static(first.get("Truth.Albedo", 0)), pixel, albedo)
        if wp.static("Id.object" in first):
            out_planes[wp.static(first.get("Id.object", 0)), pixel] = float(number)
        if wp.static("Label.object" in first):
            out_planes[wp.static(first.get("Label.object", 0)), pixel] = float(number)
        if wp.static("Id.material" in first):
            out_planes[wp.static(first.get("Id.material", 0)), pixel] = float(material)

    @wp.kernel(module="unique", enable_backward=False, module_options=kernel_options())
    def follow(
        scene: Scene,
        camera: CameraState,
        hits: wp.array[TruthHit],
        width: int,
        height: int,
        row: int,
        scale: float,
        first_pixel: int,
        out_planes: wp.array2d[float],
    ) -> None:
        pixel = first_pixel + wp.tid()
        seen = hits[pixel]
        origin = camera.positions[0]
        way = seen.anchor
        if seen.kind == TRIANGLE:
            point = surface(scene.geometry, seen.instance, seen.triangle, seen.weight0, seen.weight1, _NOW)
            way = point.position - origin
        if wp.static(features.sphere_lights):
            if seen.kind == SPHERE:
                way = centre_of(scene.geometry, seen.sphere) + seen.anchor - origin
        x = float(0.0)
        y = float(0.0)
        valid = float(0.0)
        covisible = float(0.0)
        if seen.kind != UNSEEN:
            place = project(camera, way, 0)
            valid = place[2]
            if wp.static(parallel):
                # All pixels see one place of the sky, and none of it can be followed.
                valid = wp.where(seen.kind == SKY, 0.0, valid)
            if valid > 0.0:
                x = place[0] - seen.place[0]
                y = place[1] - seen.place[1]
                # From the pixel's own middle, for that is where the point is said to be.
                right = float(pixel % width) + 0.5 + x
                down = float(pixel // width) + 0.5 + y
                if right >= 0.0 and right < float(width) and down >= 0.0 and down < float(height):
                    if wp.static(parallel):
                        axis = wp.quat_rotate(camera.rotations[0], wp.vec3(0.0, 0.0, -1.0))
                        origin = origin + way - axis * wp.dot(way, axis)
                        way = axis * wp.dot(way, axis)
                    found = solid(scene, origin, wp.normalize(way))
                    if seen.kind == SKY:
                        covisible = wp.where(found.triangle < 0 and found.sphere < 0, 1.0, 0.0)
                    else:
                        covisible = wp.where(found.t >= _NEARER * wp.length(way), 1.0, 0.0)
        out_planes[row, pixel] = x * scale
        out_planes[row + 1, pixel] = y * scale
        out_planes[row + 2, pixel] = valid
        out_planes[row + 3, pixel] = covisible

    return trace_centres, follow


def truth_features(features: Features, planes: PlaneSet) -> Features:
    """Return of a view's features those on which the kernels of truth depend, so that many scenes share them."""
    names = {plane.name for plane in planes.truth}
    normal, albedo = "Truth.Normal" in names, "Truth.Albedo" in names
    # Which surfaces stop a ray may hang on textures, and normals on which side of a material faces it.
    materials = albedo or features.alpha or features.culled_backs
    textures = features.textures and (albedo or features.alpha or (normal and features.normal_maps))
    return replace(
        features,
        smooth_normals=features.smooth_normals and (normal or albedo),
        vertex_colors=features.vertex_colors and albedo,
        normal_maps=features.normal_maps and normal,
        bump_maps=features.bump_maps and normal,
        beckmann=False,
        anisotropic=False,
        absorption=False,
        blends=features.blends and albedo,
        kinds=features.kinds if materials and albedo else ("diffuse",),
        textures=textures,
        checkers=features.checkers and textures,
        images=features.images and textures,
        roughness_textures=features.roughness_textures and albedo,
        dark_backs=features.dark_backs and albedo,
        emission_textures=False,
        transmission=False,
        mirrors=False,
        follow_specular=False,
        follow_gloss=False,
        one_sided_lamps=False,
        triangle_lights=False,
        still_lamps=False,
        punctual_lights=False,
        environment=False,
        environment_map=False,
    )
