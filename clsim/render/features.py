"""What a scene has: kernels are built for exactly that and nothing more."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from clsim.errors import InputError
from clsim.render.bsdf_kinds import KINDS
from clsim.render.deform import deforms
from clsim.scene import Camera, CheckerTexture, ImageTexture, Material, Mesh, PunctualLight, SphereLight, World
from clsim.scene.world import Kind

Strategy = Literal["mis", "light", "scatter"]
_FEW_LAMPS = 4
"""Lamps, each triangle by itself, whose light is still added up for each point that a pixel shows."""
_SHARP_DEG = 1.0
"""How wide the edge of a spot's cone is at least where its light is asked for once a pixel."""


@dataclass(frozen=True)
class SceneFeatures:
    """What a world on a device has, whoever looks at it.

    Attributes:
        two_level: something moves or deforms, and rays pass through a tree over instances; else one mesh holds all.
        smooth_normals: some mesh has shading normals.
        vertex_colors: some mesh has colours of its own.
        kinds: the scattering models of the used materials, in the order of ``bsdf_kinds.KINDS``.
        textures: some used material has a texture of any sort.
        checkers, images: some of these textures are checkerboards, or images.
        roughness_textures, emission_textures, normal_maps: some of them are of that use.
        bump_maps: some used material's normals are bent by heights.
        beckmann: some used material's microfacets are of Beckmann's distribution.
        anisotropic: some used material is rougher along one tangent than along the other.
        absorption: some used glass dims light on its way within.
        blends: some used material is a blend with another.
        alpha: some used material is cut out or translucent.
        transmission: some used material passes light to its other side.
        mirrors: some used material has points with no lobe but perfectly smooth ones.
        dark_backs: some used material's back scatters nothing.
        culled_backs: some used material's back is invisible to the camera.
        one_sided_lamps: some triangle emits from its front alone.
        triangle_lights: some triangle emits.
        still_lamps: all such triangles stand still and look the same all over.
        sphere_lights: the number of sphere lights is not zero.
        punctual_lights: the number of point, spot and directional lights is not zero.
        few_lamps: few enough shine to add up what all send to a point; none has a texture or a picture.
        light_tree: there are several lights, and which is drawn depends on the point that they light.
        environment: the environment emits.
        environment_map: the environment is an image, with the constant environment added to it.
        motion_blur: the interval lasts, and an object or a light moves or deforms.
        deforming_blur: the interval lasts, and something deforms.
        instants: rays are of several instants, and what moves has a place for each.
        deforming_instants: something deforms too, and has a shape for each.
    """

    two_level: bool
    smooth_normals: bool
    vertex_colors: bool
    kinds: tuple[Kind, ...]
    textures: bool
    checkers: bool
    images: bool
    roughness_textures: bool
    emission_textures: bool
    normal_maps: bool
    bump_maps: bool
    beckmann: bool
    anisotropic: bool
    absorption: bool
    blends: bool
    alpha: bool
    transmission: bool
    mirrors: bool
    dark_backs: bool
    culled_backs: bool
    one_sided_lamps: bool
    triangle_lights: bool
    still_lamps: bool
    sphere_lights: bool
    punctual_lights: bool
    light_pictures: bool
    few_lamps: bool
    light_tree: bool
    environment: bool
    environment_map: bool
    motion_blur: bool
    deforming_blur: bool
    instants: bool
    deforming_instants: bool

    @property
    def shading_rows(self) -> bool:
        """Whether what shading needs of a triangle's corners lies side by side: it is something, and stands still."""
        return not self.two_level and (self.smooth_normals or self.textures or self.anisotropic)


@dataclass(frozen=True)
class Features(SceneFeatures):
    """The switches of the kernel factory; a part whose switch is off is not compiled in.

    Attributes:
        follow_specular: features are of the first surface that is not a mirror or clear glass.
        camera_blur: the exposure lasts, and the camera moves.
        projection: the camera's.
        distortion: the camera's lens distorts.
        aperture: the camera's lens has a size.
        sobol: samples come from Sobol's sequence, in batches, and not from independent random numbers.
        variances: the planes of variances are wanted.
        first_hits: first hits are sampled apart from paths, which are traced where they are worth it.
        light_cache: first hits take their light from what is kept on surfaces.
        coats: what the coats of plastics reflect is kept apart from the light on their bases.
        lamp_light: light straight from lamps is found apart from paths, in closed form but for shadows.
        requests: a list tells which pixels are traced, and at which instants.
        strategy: how light is found: "mis" both ways, "light" by sampling lights alone, "scatter" by scattering alone.
            The last two are for checking the first.
    """

    follow_specular: bool
    camera_blur: bool
    projection: Literal["perspective", "fisheye"]
    distortion: bool
    aperture: bool
    sobol: bool
    variances: bool
    first_hits: bool
    light_cache: bool
    requests: bool
    coats: bool
    lamp_light: bool
    strategy: Strategy

    @property
    def sharp(self) -> bool:
        """Whether a ray sees what lies at its place in the picture, and nothing else: there is no blur of any sort."""
        return not (self.aperture or self.camera_blur or self.motion_blur)

    def describe(self) -> dict[str, list[str]]:
        """Return what is compiled in, under "built in", and what is not, under "left out"."""
        rows = (
            (self.two_level, "moving and deforming objects (two-level tree)"),
            (self.smooth_normals, "smooth shading normals"),
            (self.vertex_colors, "colours of vertices"),
            *((kind in self.kinds, f"{kind} materials") for kind in KINDS),
            (self.checkers, "checkerboard textures"),
            (self.images, "image textures"),
            (self.roughness_textures, "textures of roughness"),
            (self.emission_textures, "textures of emission"),
            (self.normal_maps, "normal maps"),
            (self.bump_maps, "bump maps"),
            (self.beckmann, "Beckmann's microfacets"),
            (self.anisotropic, "roughness that differs along u and v"),
            (self.absorption, "glass that dims light within"),
            (self.blends, "blends of materials"),
            (self.alpha, "cut-out and translucent surfaces"),
            (self.follow_specular, "features seen through mirrors and clear glass"),
            (self.dark_backs, "surfaces that are black behind"),
            (self.culled_backs, "surfaces that the camera does not see from behind"),
            (self.one_sided_lamps, "lamps that shine from one side"),
            (self.triangle_lights, "triangle area lights"),
            (self.sphere_lights, "sphere lights"),
            (self.punctual_lights, "point, spot and directional lights"),
            (self.light_tree, "choice among many lights by what each may send (light tree)"),
            (self.environment and not self.environment_map, "constant environment"),
            (self.environment_map, "environment map"),
            (self.motion_blur or self.camera_blur, "motion blur"),
            (self.deforming_blur, "motion blur of deforming objects"),
            (self.projection == "fisheye", "fisheye projection"),
            (self.distortion, "lens distortion"),
            (self.aperture, "depth of field (thin lens)"),
            (self.sobol, "Sobol's sequence"),
            (self.variances, "variance planes"),
            (self.first_hits, "first-hit rays and steered samples"),
            (self.light_cache, "light kept on surfaces"),
            (self.coats, "light of coats kept apart"),
            (self.lamp_light, "light straight from lamps in closed form"),
        )
        return {
            "built in": [text for present, text in rows if present],
            "left out": [text for present, text in rows if not present],
        }


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


def _still_lamps(world: World) -> bool:
    """Whether no triangle that emits moves or deforms, or has a texture that matters to its light."""
    return not _lamps_are_textured(world) and not _triangles_that_emit_move(world)


def _lamps_are_textured(world: World) -> bool:
    return any(
        max(material.emission) > 0 and (material.emission_texture >= 0 or material.alpha_mode != "opaque")
        for material in world.materials
    )


def _few_lamps(world: World) -> bool:
    """Whether there are some lamps but not many, whose light hardly changes within a pixel but for shadows."""
    plain = not _lamps_are_textured(world) and not _lamps_show_pictures(world)
    return plain and 0 < _lamps(world) <= _FEW_LAMPS


def _lamps_show_pictures(world: World) -> bool:
    """Whether a light without size has a picture, or a frame or a cone where its light ends at once."""
    return any(light.picture >= 0 or light.falloff == "frame" or _is_sharp(light) for light in world.punctual_lights)


def _is_sharp(light: PunctualLight) -> bool:
    return light.kind == "spot" and light.outer_deg - light.inner_deg < _SHARP_DEG


def _lamps(world: World) -> int:
    """Return how many triangles emit, and how many other lights there are but the environment."""
    emits = np.array([max(material.emission) > 0 for material in world.materials], bool)
    triangles = (np.count_nonzero(emits[world.meshes[i.mesh].material_ids]) for i in world.instances if len(emits))
    return sum(map(int, triangles)) + len(world.sphere_lights) + len(world.punctual_lights)


def _triangles_that_emit_move(world: World) -> bool:
    lamps = [max(material.emission) > 0 for material in world.materials]
    moving = {i.mesh for i in world.instances if i.motion.duration_s > 0 or deforms(world.meshes[i.mesh])}
    return any(lamps[k] for mesh in moving for k in np.unique(world.meshes[mesh].material_ids))


def lamps_move(world: World) -> bool:
    """Whether something moves, or deforms, that shines."""
    motions = [light.motion for light in world.sphere_lights] + [light.motion for light in world.punctual_lights]
    return any(motion.duration_s > 0 for motion in motions) or _triangles_that_emit_move(world)


def tree_follows(world: World) -> bool:
    """Whether the light tree holds lights that move too: where they are so many that power is a poor guide."""
    return _lamps(world) > _FEW_LAMPS


def in_light_tree(light: SphereLight | PunctualLight, follows: bool) -> bool:
    """Whether a light has a place that a tree may know; ``follows`` says that those which move are held too."""
    directional = isinstance(light, PunctualLight) and light.kind == "directional"
    return (follows or light.motion.duration_s == 0) and not directional


def _several_lights_of_a_tree(world: World) -> bool:
    """Whether there are several lights that a tree would hold; the two triangles of a panel are one light."""
    follows = tree_follows(world)
    lamps = np.array([max(material.emission) > 0 for material in world.materials], bool)
    triangles = 0
    for instance in world.instances:
        mesh = world.meshes[instance.mesh]
        if len(lamps) and (follows or instance.motion.duration_s == 0) and not deforms(mesh):
            triangles += int(np.count_nonzero(lamps[mesh.material_ids]))
    small: tuple[SphereLight | PunctualLight, ...] = (*world.sphere_lights, *world.punctual_lights)
    others = sum(in_light_tree(light, follows) for light in small)
    return triangles > 2 or (triangles > 0) + others > 1


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


def check_kept_light(world: World, light_cache: bool) -> None:
    """Raise InputError where light shall be kept on surfaces and does not stand still."""
    if light_cache and not light_stands_still(world):
        raise InputError("light is kept on surfaces only where nothing but the camera moves")


def scene_features(world: World, interval_s: float, instants: bool = False) -> SceneFeatures:
    """Return what the world needs on a device, over an interval of that length [s], or at several ``instants``."""
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
        dark_backs=any(material.back == "black" and not passes_light(material) for material in materials),
        culled_backs=any(material.back == "culled" for material in materials),
        one_sided_lamps=any(max(material.emission) > 0 and not material.emits_behind for material in materials),
        triangle_lights=any(max(material.emission) > 0 for material in materials),
        still_lamps=_still_lamps(world),
        sphere_lights=bool(world.sphere_lights),
        punctual_lights=bool(world.punctual_lights),
        light_pictures=any(light.picture >= 0 for light in world.punctual_lights),
        few_lamps=_few_lamps(world),
        light_tree=_several_lights_of_a_tree(world),
        environment=max(world.environment) > 0 or world.environment_map is not None,
        environment_map=world.environment_map is not None,
        motion_blur=interval_s > 0 and (deforming or objects_move(world)),
        deforming_blur=interval_s > 0 and deforming,
        instants=instants and (deforming or objects_move(world)),
        deforming_instants=instants and deforming,
    )


def light_is_found_apart(world: World) -> bool:
    """Whether light straight from lamps is found apart from paths, where first hits are; paths find the rest."""
    return _lamps_apart(scene_features(world, 0.0), "mis")


def _lamps_apart(scene: SceneFeatures, strategy: Strategy) -> bool:
    """Whether light straight from lamps may be found apart from paths."""
    plain = not (scene.blends or scene.absorption or scene.motion_blur or scene.light_tree)
    return plain and scene.few_lamps and "diffuse" in scene.kinds and strategy == "mis"


def view_features(
    scene: SceneFeatures,
    camera: Camera,
    variances: bool = False,
    strategy: Strategy = "mis",
    follow_specular: bool = True,
    sobol: bool = False,
    first_hits: bool = False,
    light_cache: bool = False,
    requests: bool = False,
) -> Features:
    """Return the features of the kernel with which a camera looks at such a scene."""
    return Features(
        **vars(scene),
        follow_specular=follow_specular and scene.mirrors,
        camera_blur=camera.shutter_s > 0 and camera.motion.duration_s > 0,
        projection=camera.lens.model,
        distortion=any(camera.lens.distortion),
        aperture=camera.lens.aperture_radius_m > 0,
        sobol=sobol,
        variances=variances,
        first_hits=first_hits,
        light_cache=light_cache,
        requests=requests,
        coats=light_cache and "plastic" in scene.kinds and not scene.blends,
        lamp_light=first_hits and _lamps_apart(scene, strategy),
        strategy=strategy,
    )
