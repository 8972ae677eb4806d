"""What a scene and a camera have: kernels are built for exactly that and nothing more."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from clsim.render.features.bsdf_kinds import KINDS
from clsim.scene import Camera
from clsim.scene.world import Kind, LensModel

COATED = frozenset(("plastic", "principled", "disney"))
"""Materials whose reflection is cached separately from the light on what lies below it."""
LAMBERTIAN_BELOW = frozenset(("plastic", "principled"))
"""Those of them whose lamps' light on what lies below is known in closed form."""
Strategy = Literal["mis", "light", "scatter"]


@dataclass(frozen=True)
class SceneFeatures:
    """What a world on a device has, whatever the camera.

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
        glossy: some used material has points of a metal or glass that is neither smooth nor matt.
        dark_backs: some used material's back scatters nothing.
        culled_backs: some used material's back is invisible to the camera.
        one_sided_lamps: some triangle emits from its front alone.
        triangle_lights: some triangle emits.
        still_lamps: all such triangles stand still and shine the same all over.
        sphere_lights: the number of sphere lights is not zero.
        sphere_tree: there are so many that rays find them by a tree.
        punctual_lights: the number of point, spot and directional lights is not zero.
        lamps_move: something that shines moves or deforms.
        few_lamps: few enough shine to add up what all send to a point; none has a texture or a picture.
        diffuse_lit: some used material that sends out no light is diffuse.
        light_tree: there are several lights, and which is drawn depends on the point that they light.
        environment: the environment emits.
        environment_map: the environment is an image, with the constant environment added to it.
        motion_blur: the interval lasts, and an object or a light moves or deforms.
        deforming_blur: the interval lasts, and something deforms.
        instants: rays are of several instants, and what moves has a place for each.
        deforming_instants: something deforms too, and has a shape for each.
        deforms: something deforms.
        light_changes: more than the camera moves, or some light changes by itself.
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
    glossy: bool
    dark_backs: bool
    culled_backs: bool
    one_sided_lamps: bool
    triangle_lights: bool
    still_lamps: bool
    sphere_lights: bool
    sphere_tree: bool
    punctual_lights: bool
    light_pictures: bool
    few_lamps: bool
    diffuse_lit: bool
    lamps_move: bool
    light_tree: bool
    environment: bool
    environment_map: bool
    motion_blur: bool
    deforming_blur: bool
    instants: bool
    deforming_instants: bool
    deforms: bool
    light_changes: bool

    @property
    def shading_rows(self) -> bool:
        """Whether what shading needs of a triangle's corners lies side by side: it is something, and stands still."""
        return not self.two_level and (self.smooth_normals or self.textures or self.anisotropic)


@dataclass(frozen=True)
class Features(SceneFeatures):
    """The switches of the kernel factory; a part whose switch is off is not compiled in.

    Attributes:
        follow_specular: features are of the first surface that is not a mirror or clear glass.
        follow_gloss: nor of glossy metal or frosted glass (`Bsdf.glossy`): what these show hangs on the direction
            from which they are seen, which the cache does not know.
        camera_blur: the exposure lasts, and the camera moves.
        projection: the camera's.
        distortion: the camera's lens distorts.
        aperture: the camera's lens has a size.
        sobol: samples come from Sobol's sequence, in batches, and not from independent random numbers.
        variances: the planes of variances are wanted.
        first_hits: primary rays find first hits, and paths are traced where they are worth it.
        light_cache: first hits take their light from the radiance cache.
        coats: what the coats of plastics reflect is cached separately from the light on their bases.
        lamp_light: direct light is analytic, but for its shadows.
        requests: a list tells which pixels are traced, and at which instants.
        strategy: how light is found: "mis" both ways, "light" by sampling lights alone, "scatter" by scattering alone.
            The last two are for checking the first.
        replay: stored paths are traced again, and nothing else.
    """

    follow_specular: bool
    follow_gloss: bool
    camera_blur: bool
    projection: LensModel
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
    replay: bool = False

    @property
    def anchored(self) -> bool:
        """Whether cells of light lie on what moves, and paths are stored in them."""
        return self.light_cache and self.light_changes

    @property
    def shadow_rays(self) -> bool:
        """Whether kernels record which shadow rays of a pixel reach the lamps: direct light is analytic, and cached."""
        return self.light_cache and self.lamp_light and self.sharp and not self.alpha

    @property
    def sharp(self) -> bool:
        """Whether a ray sees what lies at its place in the picture, and nothing else: there is no blur of any sort."""
        return not (self.aperture or self.camera_blur or self.motion_blur)

    @property
    def stores_hits(self) -> bool:
        """Whether what pixels saw is stored for the next frame, should the camera stand: all rays begin there."""
        frames = not (self.requests or self.replay) and self.first_hits
        return frames and self.anchored and self.sharp and self.projection != "orthographic"

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
            (self.follow_gloss, "what glossy metal and frosted glass show, by primary rays"),
            (self.dark_backs, "surfaces that are black behind"),
            (self.culled_backs, "surfaces that the camera does not see from behind"),
            (self.one_sided_lamps, "lamps that shine from one side"),
            (self.triangle_lights, "triangle area lights"),
            (self.sphere_lights, "sphere lights"),
            (self.sphere_tree, "tree over sphere lights"),
            (self.punctual_lights, "point, spot and directional lights"),
            (self.light_tree, "choice among many lights by what each may send (light tree)"),
            (self.environment and not self.environment_map, "constant environment"),
            (self.environment_map, "environment map"),
            (self.motion_blur or self.camera_blur, "motion blur"),
            (self.deforming_blur, "motion blur of deforming objects"),
            (self.projection == "fisheye", "fisheye projection"),
            (self.projection == "orthographic", "orthographic projection"),
            (self.distortion, "lens distortion"),
            (self.aperture, "depth of field (thin lens)"),
            (self.sobol, "Sobol's sequence"),
            (self.variances, "variance planes"),
            (self.first_hits, "first-hit rays and steered samples"),
            (self.light_cache, "cached light"),
            (self.anchored, "stored paths that follow the light"),
            (self.coats, "light of coats, cached separately"),
            (self.lamp_light, "light straight from lamps in closed form"),
        )
        return {
            "built in": [text for present, text in rows if present],
            "left out": [text for present, text in rows if not present],
        }


def has_analytic_direct_light(scene: SceneFeatures, strategy: Strategy, light_cache: bool) -> bool:
    """Whether direct light may be analytic instead of being found by paths; under coats only where light is cached."""
    plain = not (scene.blends or scene.absorption or scene.motion_blur or scene.light_tree)
    lit = scene.diffuse_lit or (light_cache and not LAMBERTIAN_BELOW.isdisjoint(scene.kinds))
    return plain and scene.few_lamps and lit and strategy == "mis"


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
    lights_set: bool = False,
    replay: bool = False,
) -> Features:
    """Return the features of the kernel with which a camera renders such a scene."""
    lamp_light = first_hits and has_analytic_direct_light(scene, strategy, light_cache)
    follow_gloss = follow_specular and light_cache and scene.glossy
    changes = light_cache and (scene.light_changes or lights_set)
    about_cached_light = {"light_changes": changes, "deforms": light_cache and scene.deforms}
    return Features(
        # Of how many lamps there are, whether they move and what they light, other kernels know nothing, and are the
        # same ones.
        **(vars(scene) | {"few_lamps": lamp_light, "lamps_move": False, "diffuse_lit": False} | about_cached_light),
        follow_specular=follow_gloss or (follow_specular and scene.mirrors),
        follow_gloss=follow_gloss,
        camera_blur=camera.shutter_s > 0 and camera.motion.duration_s > 0,
        projection=camera.lens.model,
        distortion=any(camera.lens.distortion),
        aperture=camera.lens.aperture_radius_m > 0,
        sobol=sobol,
        # Requests have no planes for them.
        variances=variances and not requests,
        first_hits=first_hits,
        light_cache=light_cache,
        requests=requests,
        coats=light_cache and not COATED.isdisjoint(scene.kinds),
        lamp_light=lamp_light,
        strategy=strategy,
        replay=replay,
    )
