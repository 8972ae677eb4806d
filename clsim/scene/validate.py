"""Checks that every loader's world must pass before anything renders it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import get_args

import numpy as np

from clsim.errors import InputError
from clsim.scene.light.spectral import are_weights
from clsim.scene.meshes.geometry import is_similarity
from clsim.scene.modulation import Modulation
from clsim.scene.motion import Motion
from clsim.scene.world import (
    TEXTURES,
    AlphaMode,
    Camera,
    CheckerTexture,
    Distribution,
    Kind,
    Material,
    Mesh,
    Texture,
    World,
    Wrap,
)

MAX_SIDE = 16384
MAX_PIXELS = 1 << 26
SHARES = (
    "alpha",
    "metallic",
    "transmission",
    "clearcoat",
    "clearcoat_alpha",
    "specular_tint",
    "sheen_tint",
    "flatness",
    "opacity",
    "blend_share",
)
"""What of a material is a number from 0 to 1."""
BRIGHTEST = 1e30
"""Largest radiance and intensity: times a large area, more cannot be held in float32."""
SMALLEST_FLOOR = 1.2e-38
"""Smaller numbers are subnormal in float32: some devices take them for 0."""


def validate(world: World, source: str) -> None:
    """Check a world: finite numbers, indices in range, positive sizes, rigid poses.

    Raises:
        InputError: naming the source and the mesh, light or camera, one line per problem (at most ten).
    """
    problems: list[str] = []
    for problem in _problems(world):
        problems.append(f"{source}: {problem}")
        if len(problems) == 10:
            break
    if problems:
        raise InputError("\n".join(problems))


def _problems(world: World) -> Iterator[str]:
    yield from _camera_problems(world.camera)
    names = {instance.mesh: instance.name for instance in reversed(world.instances)}
    for i, mesh in enumerate(world.meshes):
        for problem in _mesh_problems(mesh, len(world.materials)):
            yield f"mesh {names.get(i) or i}: {problem}"
    for k, instance in enumerate(world.instances):
        name = f"object {instance.name or k}"
        if not 0 <= instance.mesh < len(world.meshes):
            yield f"{name}: uses mesh {instance.mesh}, expected one of the {len(world.meshes)} meshes"
        yield from _motion_problems(name, instance.motion)
    for k, material in enumerate(world.materials):
        yield from _material_problems(f"material {material.name or k}", material, len(world.textures))
        if not -1 <= material.blend_with < len(world.materials):
            name = material.name or str(k)
            yield f"material {name}: blends with {material.blend_with}, of {len(world.materials)} materials"
    for k, texture in enumerate(world.textures):
        yield from _texture_problems(f"texture {k}", texture)
    for k, light in enumerate(world.sphere_lights):
        if not (_within((light.radius_m,)) and light.radius_m > 0):
            yield f"sphere light {k}: radius is {light.radius_m} m, expected a positive number"
        if not _within(light.radiance, BRIGHTEST):
            yield f"sphere light {k}: radiance is {light.radiance}, expected numbers from 0 to {BRIGHTEST:g}"
        yield from _motion_problems(f"sphere light {k}", light.motion)
    for k, punctual in enumerate(world.punctual_lights):
        name = f"{punctual.kind} light {k}"
        if not _within(punctual.intensity, BRIGHTEST):
            yield f"{name}: intensity is {punctual.intensity}, expected numbers from 0 to {BRIGHTEST:g}"
        if not 0 <= punctual.inner_deg <= punctual.outer_deg <= 90:
            yield f"{name}: angles are {punctual.inner_deg} and {punctual.outer_deg}, expected 0 ≤ inner ≤ outer ≤ 90"
        if not -1 <= punctual.picture < len(world.textures):
            yield f"{name}: picture is {punctual.picture}, expected -1 or one of the {len(world.textures)} textures"
        if not _within(map(abs, punctual.picture_size)) or 0 in punctual.picture_size:
            yield f"{name}: picture_size is {punctual.picture_size}, expected finite numbers other than 0"
        yield from _motion_problems(name, punctual.motion)
    if world.environment_map is not None:
        radiance = world.environment_map.radiance
        if radiance.ndim != 3 or radiance.shape[2] != 3 or not radiance.size:
            yield f"environment map: has shape {radiance.shape}, expected height, width and 3"
        elif not np.isfinite(radiance).all() or radiance.min() < 0:
            yield "environment map: has a radiance that is negative or not finite"
    for name, modulation in world.modulations():
        yield from _modulation_problems(name, modulation)
    if not _within(world.environment, BRIGHTEST):
        yield f"environment: radiance is {world.environment}, expected numbers from 0 to {BRIGHTEST:g}"
    sensor = world.sensor
    for key in ("threshold_on", "threshold_off", "scale", "floor", "lux_per_unit"):
        if not 0 < getattr(sensor, key) < math.inf:
            yield f"sensor: {key} is {getattr(sensor, key)}, expected a positive number"
    if not are_weights(sensor.spectral):
        yield f"sensor: spectral is {sensor.spectral}, expected weights of R, G and B from 0, and not all 0"
    if 0 < sensor.floor < SMALLEST_FLOOR:
        yield f"sensor: floor is {sensor.floor:g}, expected at least {SMALLEST_FLOOR:g}"
    for key in ("fps", "duration_s"):
        if not 0 < getattr(world, key) < math.inf:
            yield f"{key} is {getattr(world, key)}, expected a positive number"


def _modulation_problems(name: str, modulation: Modulation) -> Iterator[str]:
    """What would make light negative or no number, at the start and the end of the change."""
    if not _within((modulation.largest, modulation.least_fps, modulation.duration_s), BRIGHTEST):
        yield f"the light of {name}: changes by factors up to {modulation.largest}, expected finite numbers from 0"
        return
    if any(not _within(modulation.mean(time_s, time_s)) for time_s in (0.0, modulation.duration_s)):
        yield f"the light of {name}: changes by a factor that is negative or not finite"


def _material_problems(name: str, material: Material, textures: int) -> Iterator[str]:
    if material.kind not in get_args(Kind):
        yield f"{name}: kind is {material.kind!r}, expected one of {', '.join(get_args(Kind))}"
    if material.alpha_mode not in get_args(AlphaMode):
        yield f"{name}: alpha_mode is {material.alpha_mode!r}, expected one of {', '.join(get_args(AlphaMode))}"
    if material.distribution not in get_args(Distribution):
        expected = ", ".join(get_args(Distribution))
        yield f"{name}: distribution is {material.distribution!r}, expected one of {expected}"
    for key in TEXTURES:
        if not -1 <= getattr(material, key) < textures:
            yield f"{name}: {key} is {getattr(material, key)}, expected -1 or one of the {textures} textures"
    if not _within(material.color, 1.0):
        yield f"{name}: color is {material.color}, expected numbers from 0 to 1"
    for key in SHARES:
        if not _within((getattr(material, key),), 1.0):
            yield f"{name}: {key} is {getattr(material, key)}, expected a number from 0 to 1"
    # Beyond 1 a cut-off cuts everything, which glTF allows.
    if not _within((material.alpha_cutoff,)):
        yield f"{name}: alpha_cutoff is {material.alpha_cutoff}, expected a finite number from 0"
    for key in ("normal_scale", "bump_scale"):
        if not math.isfinite(getattr(material, key)):
            yield f"{name}: {key} is {getattr(material, key)}, expected a finite number"
    if not 0 < material.ior < math.inf:
        yield f"{name}: ior is {material.ior}, expected a positive number"
    if material.kind == "disney" and material.ior <= 1:
        yield f"{name}: ior is {material.ior}, expected more than 1 for the kind disney"
    if not 0 < material.stretch < math.inf:
        yield f"{name}: stretch is {material.stretch}, expected a positive number"
    if not _within((material.sheen,)):
        yield f"{name}: sheen is {material.sheen}, expected a finite number from 0"
    if not _within(material.emission, BRIGHTEST):
        yield f"{name}: emission is {material.emission}, expected numbers from 0 to {BRIGHTEST:g}"
    for key in ("eta", "k", "specular_color", "absorption"):
        if not _within(getattr(material, key) or ()):
            yield f"{name}: {key} is {getattr(material, key)}, expected finite numbers from 0"


def _texture_problems(name: str, texture: Texture) -> Iterator[str]:
    if isinstance(texture, CheckerTexture):
        for key in ("color_a", "color_b"):
            if not _within(getattr(texture, key), 1.0):
                yield f"{name}: {key} is {getattr(texture, key)}, expected numbers from 0 to 1"
        if not math.isfinite(texture.scale):
            yield f"{name}: scale is {texture.scale}, expected a finite number"
        return
    pixels = texture.pixels
    if pixels.dtype != np.uint8 or pixels.ndim != 3 or pixels.shape[2] != 4 or not pixels.size:
        yield f"{name}: pixels are {pixels.dtype} of shape {pixels.shape}, expected uint8 of height, width and 4"
    for key in ("wrap_u", "wrap_v"):
        if getattr(texture, key) not in get_args(Wrap):
            yield f"{name}: {key} is {getattr(texture, key)!r}, expected one of {', '.join(get_args(Wrap))}"
    if not np.isfinite(texture.uv_matrix).all():
        yield f"{name}: uv_matrix is {texture.uv_matrix}, expected finite numbers"


def _camera_problems(camera: Camera) -> Iterator[str]:
    for key in ("width", "height"):
        if not 1 <= getattr(camera, key) <= MAX_SIDE:
            yield f"camera: {key} is {getattr(camera, key)} pixels, expected 1 to {MAX_SIDE}"
    if camera.width * camera.height > MAX_PIXELS:
        yield f"camera: {camera.width}×{camera.height} is more than {MAX_PIXELS} pixels"
    lens = camera.lens
    widest, terms = (360, 4) if lens.model == "fisheye" else (180, 5)
    if lens.model == "orthographic":
        if not 0 < lens.view_width_m < math.inf:
            yield f"camera: view_width_m is {lens.view_width_m}, expected a positive number for an orthographic lens"
        if lens.aperture_radius_m or any(lens.distortion):
            yield "camera: an orthographic lens has no aperture_radius_m and no distortion, expected 0"
    elif not 0 < camera.fov_deg < widest:
        yield f"camera: fov_deg is {camera.fov_deg}, expected more than 0 and less than {widest}"
    if not all(map(math.isfinite, lens.principal_point)):
        yield f"camera: principal_point is {lens.principal_point}, expected finite numbers"
    if not 0 < lens.aspect < math.inf:
        yield f"camera: aspect is {lens.aspect}, expected a positive number"
    if len(lens.distortion) > terms or not all(map(math.isfinite, lens.distortion)):
        yield f"camera: distortion is {lens.distortion}, expected at most {terms} finite numbers"
    if not _within((lens.aperture_radius_m,)) or not 0 < lens.focus_distance_m < math.inf:
        yield (
            f"camera: aperture radius {lens.aperture_radius_m} m and focus distance {lens.focus_distance_m} m, "
            "expected a number from 0 and a positive one"
        )
    if not 0 <= camera.shutter_s < math.inf:
        yield f"camera: shutter_s is {camera.shutter_s}, expected a number from 0"
    yield from _motion_problems("camera", camera.motion)


def _mesh_problems(mesh: Mesh, materials: int) -> Iterator[str]:
    n, m = len(mesh.vertices), len(mesh.triangles)
    if m == 0:
        yield "has no triangles"
    for key, array, shape in (
        ("vertices", mesh.vertices, (n, 3)),
        ("triangles", mesh.triangles, (m, 3)),
        ("material ids", mesh.material_ids, (m,)),
        ("normals", mesh.normals, (n, 3)),
        ("uvs", mesh.uvs, (n, 2)),
        ("colors", mesh.colors, (n, 3)),
    ):
        if array is not None and array.shape != shape:
            yield f"{key} have shape {array.shape}, expected {shape}"
        elif array is not None and array.dtype.kind == "f":
            bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
            if len(bad):
                value = ", ".join(f"{x:g}" for x in array[bad[0]])
                yield f"{key}[{bad[0]}] is ({value}), expected finite numbers"
    if m and (mesh.triangles.min() < 0 or mesh.triangles.max() >= n):
        wrong = mesh.triangles[(mesh.triangles < 0) | (mesh.triangles >= n)][0]
        yield f"a triangle uses vertex {wrong}, expected 0 to {n - 1}"
    if len(mesh.material_ids) and not (mesh.material_ids.min() >= 0 and mesh.material_ids.max() < materials):
        yield f"a triangle uses a material out of range, expected 0 to {materials - 1}"


def _motion_problems(name: str, motion: Motion) -> Iterator[str]:
    if not 0 <= motion.duration_s < math.inf:
        yield f"{name}: its motion lasts {motion.duration_s} s, expected a finite time"
        return
    for time_s in (0.0, motion.duration_s / 2, motion.duration_s):
        matrix = motion.pose(time_s)
        if matrix.shape != (4, 4) or not np.isfinite(matrix.astype(np.float32)).all():
            yield f"{name}: its pose at {time_s:g} s has a number that is not finite"
            return
        if not is_similarity(matrix[:3, :3]):
            yield f"{name}: its pose at {time_s:g} s is not a rotation with one positive scale"
            return


def _within(values: Iterable[float], highest: float = math.inf) -> bool:
    return all(math.isfinite(value) and 0 <= value <= highest for value in values)
