"""The features of a world for which kernels are built."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from clsim.render.features.bsdf_kinds import KINDS
from clsim.render.features.features import SceneFeatures, has_analytic_direct_light
from clsim.render.features.scene_lamps import few_lamps, lamps_move, several_lights_of_a_tree, still_lamps
from clsim.render.motion.deform import deforms
from clsim.scene import CheckerTexture, ImageTexture, Material, Mesh, World
from clsim.scene.driven import stands_still

_SPHERES_OF_A_TREE = 32
"""Sphere lights from which on a tree costs rays less than to meet one after the other."""


def _used_meshes(world: World) -> list[Mesh]:
    return [world.meshes[index] for index in sorted({instance.mesh for instance in world.instances})]


def _used_materials(world: World) -> list[Material]:
    meshes = _used_meshes(world)
    used = {int(i) for mesh in meshes for i in np.unique(mesh.material_ids)}
    others = {world.materials[i].blend_with for i in used} - {-1}
    while others - used:
        used |= others
        others = {world.materials[i].blend_with for i in used} - {-1}
    return [world.materials[i] for i in sorted(used)]


def textures_of(material: Material) -> dict[str, int]:
    """Return the textures that the tracer reads for a material, by use."""
    uses = {
        "color": material.texture,
        "emission": material.emission_texture if max(material.emission) > 0 else -1,
        "roughness": material.roughness_texture if has_roughness(material) else -1,
        "normal": material.normal_texture,
        "bump": material.bump_texture,
        "blend": material.blend_texture if material.blend_with >= 0 else -1,
        "opacity": material.opacity_texture if material.alpha_mode != "opaque" else -1,
    }
    return {use: index for use, index in uses.items() if index >= 0}


def has_roughness(material: Material) -> bool:
    """Whether a texture of roughness means anything for the material."""
    return material.kind in ("conductor", "dielectric", "plastic", "principled", "disney")


def passes_light(material: Material) -> bool:
    """Whether light crosses the surface other than through its cut-outs."""
    passes = material.kind in ("principled", "disney") and material.transmission > 0
    return passes or material.kind in ("dielectric", "thin-dielectric")


def may_be_mirror(material: Material) -> bool:
    """Whether the material has points with no lobe but perfectly smooth ones."""
    if material.kind == "principled":
        single = material.metallic >= 1 or material.transmission >= 1
        return single and (material.alpha < 1e-3 or material.roughness_texture >= 0)
    if material.kind in ("conductor", "dielectric"):
        return material.alpha < 1e-3 or material.roughness_texture >= 0
    return material.kind == "thin-dielectric"


def may_be_glossy(material: Material) -> bool:
    """Whether the material has points of a metal or glass that is neither smooth nor matt; see `Bsdf.glossy`."""
    layered = material.kind in ("principled", "disney") and max(material.metallic, material.transmission) >= 0.5
    even = material.normal_texture < 0 and material.bump_texture < 0
    return (layered or material.kind in ("conductor", "dielectric")) and even and material.alpha >= 1e-3


def used_textures(world: World) -> list[int]:
    """Return the indices of the textures that the tracer reads."""
    of_surfaces = {index for material in _used_materials(world) for index in textures_of(material).values()}
    return sorted(of_surfaces | {light.picture for light in world.punctual_lights if light.picture >= 0})


def objects_move(world: World) -> bool:
    """Whether an object or a light moves rigidly."""
    _, *others = world.motions()
    return any(motion.duration_s > 0 for motion in others)


def light_stands_still(world: World) -> bool:
    """Whether nothing but the camera moves, and no light changes, so that the light on a surface stays as it is."""
    deforming = any(deforms(mesh) for mesh in _used_meshes(world))
    return not (deforming or objects_move(world) or world.light_changes())


def camera_watches(world: World) -> bool:
    """Whether the camera stands still, unless it is set from outside, and light changes by what moves alone."""
    return stands_still(world.camera.motion) and not world.light_changes()


def scene_features(world: World, interval_s: float, instants: bool = False, light_cache: bool = False) -> SceneFeatures:
    """Return what the world needs on a device, over an interval of that length [s], or at several ``instants``.

    With a ``light_cache`` direct light of few lamps is analytic: then these need no tree.
    """
    found = _features_of(world, interval_s, instants)
    if light_cache:
        without_tree = replace(found, light_tree=False)
        found = without_tree if has_analytic_direct_light(without_tree, "mis", light_cache) else found
    return found


def _features_of(world: World, interval_s: float, instants: bool) -> SceneFeatures:
    meshes, materials = _used_meshes(world), _used_materials(world)
    kinds = {material.kind for material in materials} or {"diffuse"}
    uses = {use for material in materials for use in textures_of(material)}
    textures = [world.textures[index] for index in used_textures(world)]
    deforming = any(deforms(mesh) for mesh in meshes)
    return SceneFeatures(
        two_level=deforming or any(instance.motion.duration_s > 0 for instance in world.instances),
        smooth_normals=any(mesh.normals is not None for mesh in meshes),
        vertex_colors=any(mesh.colors is not None for mesh in meshes),
        kinds=tuple(kind for kind in KINDS if kind in kinds),
        textures=bool(textures),
        checkers=any(isinstance(texture, CheckerTexture) for texture in textures),
        images=any(isinstance(texture, ImageTexture) for texture in textures),
        roughness_textures="roughness" in uses,
        emission_textures="emission" in uses,
        normal_maps="normal" in uses or "bump" in uses,
        bump_maps="bump" in uses,
        beckmann=any(material.distribution == "beckmann" for material in materials),
        anisotropic=any(material.stretch != 1 for material in materials),
        absorption=any(max(material.absorption) > 0 and passes_light(material) for material in materials),
        blends=any(material.blend_with >= 0 for material in materials),
        alpha=any(material.alpha_mode != "opaque" for material in materials),
        transmission=any(passes_light(material) for material in materials),
        mirrors=any(may_be_mirror(material) for material in materials),
        glossy=any(may_be_glossy(material) for material in materials),
        dark_backs=any(material.back == "black" and not passes_light(material) for material in materials),
        culled_backs=any(material.back == "culled" for material in materials),
        one_sided_lamps=any(max(material.emission) > 0 and not material.emits_behind for material in materials),
        triangle_lights=any(max(material.emission) > 0 for material in materials),
        still_lamps=still_lamps(world),
        sphere_lights=bool(world.sphere_lights),
        sphere_tree=len(world.sphere_lights) >= _SPHERES_OF_A_TREE,
        punctual_lights=bool(world.punctual_lights),
        light_pictures=any(light.picture >= 0 for light in world.punctual_lights),
        few_lamps=few_lamps(world),
        diffuse_lit=any(material.kind == "diffuse" and max(material.emission) == 0 for material in materials),
        lamps_move=lamps_move(world),
        light_tree=several_lights_of_a_tree(world),
        environment=max(world.environment) > 0 or world.environment_map is not None,
        environment_map=world.environment_map is not None,
        motion_blur=interval_s > 0 and (deforming or objects_move(world)),
        deforming_blur=interval_s > 0 and deforming,
        instants=instants and (deforming or objects_move(world)),
        deforming_instants=instants and deforming,
        deforms=deforming,
        light_changes=not light_stands_still(world),
    )


def direct_light_is_analytic(world: World) -> bool:
    """Whether direct light is analytic at first hits, where light is cached; paths find the rest."""
    return has_analytic_direct_light(scene_features(world, 0.0, light_cache=True), "mis", light_cache=True)
