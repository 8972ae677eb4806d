"""The world as the renderer takes it: plain numpy arrays, resolved from whatever file described it.

Right-handed, +y up, metres, seconds; colours are linear Rec. 709; radiance in W·sr⁻¹·m⁻².
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np
import numpy.typing as npt

from clsim.scene.modulation import Modulation
from clsim.scene.motion import Attached, Matrix, Motion, Static
from clsim.scene.pictures.film import Film

Vec3 = tuple[float, float, float]
F32 = npt.NDArray[np.float32]
I32 = npt.NDArray[np.int32]
Wrap = Literal["repeat", "clamp", "mirror"]
Kind = Literal["diffuse", "conductor", "dielectric", "thin-dielectric", "plastic", "principled", "disney"]
AlphaMode = Literal["opaque", "mask", "blend"]
Distribution = Literal["ggx", "beckmann"]
Back = Literal["same", "black", "culled"]
LensModel = Literal["perspective", "fisheye", "orthographic"]
Falloff = Literal["squared", "linear", "smooth", "frame"]
Spectral = Literal["luminance", "silicon"] | Vec3
Mosaic = tuple[Vec3, Vec3, Vec3, Vec3]
"""Weights of R, G and B of the pixels (0, 0), (1, 0), (0, 1) and (1, 1) of each square of four, x first."""


class Deformation(Protocol):
    """Vertices that move within their mesh: a skin, or morph targets."""

    @property
    def duration_s(self) -> float:
        """Length of the animation [s]."""
        ...

    def vertices_at(self, time_s: float) -> tuple[F32, F32 | None]:
        """Return vertices ``[n, 3]`` [m] and shading normals ``[n, 3]`` (None: flat) at a time, in object space."""
        ...


def scaled(color: Vec3, factor: float) -> Vec3:
    """Return a colour times a factor."""
    return color[0] * factor, color[1] * factor, color[2] * factor


@dataclass(frozen=True)
class Mesh:
    """Triangles in object space.

    Attributes:
        vertices: float32 ``[n, 3]`` [m].
        triangles: int32 ``[m, 3]``, counter-clockwise seen from the front.
        normals: float32 ``[n, 3]`` unit shading normals, or None for flat shading.
        uvs: float32 ``[n, 2]``, u right and v up, or None.
        material_ids: int32 ``[m]``, one per triangle, into ``World.materials``.
        colors: float32 ``[n, 3]``, linear, 0 … 1, by which the material's colour is multiplied; None is white.
    """

    vertices: F32
    triangles: I32
    material_ids: I32
    normals: F32 | None = None
    uvs: F32 | None = None
    colors: F32 | None = None
    deformation: Deformation | None = None


@dataclass(frozen=True)
class Instance:
    """A mesh placed in the world; several instances may share one mesh."""

    mesh: int
    motion: Motion
    name: str = ""


@dataclass(frozen=True)
class CheckerTexture:
    """Two colours in squares; ``scale`` squares per unit of u and v."""

    color_a: Vec3
    color_b: Vec3
    scale: float = 1.0


@dataclass(frozen=True)
class ImageTexture:
    """An image, sampled bilinearly unless ``nearest``.

    Attributes:
        pixels: uint8 ``[h, w, 4]`` RGBA, row 0 at v = 1 (the top of the image).
        srgb: whether R, G, B are sRGB-encoded (colours) or plain numbers (roughness, normals).
        wrap_u, wrap_v: what lies outside 0…1.
        uv_matrix: 2×3 matrix applied to (u, v, 1) first.
        film: what takes the place of ``pixels`` as time goes on, of colours and of what emits.
    """

    pixels: npt.NDArray[np.uint8]
    srgb: bool = True
    wrap_u: Wrap = "repeat"
    wrap_v: Wrap = "repeat"
    nearest: bool = False
    uv_matrix: tuple[Vec3, Vec3] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    film: Film | None = None


Texture = CheckerTexture | ImageTexture


@dataclass(frozen=True)
class Material:
    """A surface. Textures are indices into ``World.textures``, -1 for none.

    Attributes:
        kind: the scattering model: ``diffuse``; ``conductor`` (metal: complex index ``eta``, ``k``, or Schlick with
            F0 = ``color`` where ``eta`` is None); ``dielectric`` (glass, refracting, index ``ior``);
            ``thin-dielectric`` (a pane); ``plastic`` (a dielectric coat of index ``ior`` over a diffuse base);
            ``principled`` (glTF metallic-roughness with clearcoat and transmission); ``disney`` (the model of Burley,
            SIGGRAPH 2012 and 2015, as Mitsuba's ``principled`` has it: what passes is refracted).
        color: diffuse reflectance or base colour, Schlick's F0 of a metal, what glass lets pass (multiplied by the
            texture where there is one).
        emission: radiance that the surface emits; a triangle that emits is an area light.
        modulation: how the emission changes with time.
        emits_behind: whether the back emits as the front does.
        back: what else the back does: ``same`` scatters as the front; ``black`` scatters nothing (Mitsuba's surfaces
            that are not ``twosided``); ``culled`` is invisible to the camera, but scatters and blocks light as the
            front does (glTF's single-sided faces). Glass and what else passes light scatters on both sides.
        alpha: roughness α of the specular lobe; 0 is a perfect mirror or smooth glass.
        distribution: of the microfacets of ``conductor``, ``dielectric`` and ``plastic``; others have GGX's.
        roughness_texture: G is perceptual roughness (α = (G·√alpha)²), B metalness, as in glTF.
        specular_color: multiplies the specular lobe; of glass and panes what they reflect, of ``principled`` F0 and
            F90 of its dielectric layer.
        specular_tint, sheen, sheen_tint, flatness: what only ``disney`` has; 0 … 1.
        stretch: roughness along u is α·stretch and along v α/stretch, of ``conductor``, ``dielectric``, ``disney``.
        absorption: how much light dims within ``dielectric`` or ``disney`` glass [m⁻¹]: by exp(−absorption·way).
        nonlinear: plastic's colour shift by inner reflections (Mitsuba's ``nonlinear``).
        bump_texture: its luminance is height over the surface, ``bump_scale`` metres for 1; it bends normals.
        blend_with: index of another material of which this one is a blend; -1 for none. That may be one again.
        blend_share: share of the other one; 0 … 1.
        blend_texture: its luminance multiplies that share.
        blend_behind: the other one is instead what the whole back shows, and nothing of the front.
        alpha_mode: ``opaque``; ``mask`` cuts where opacity < ``alpha_cutoff``; ``blend`` lets that share through.
        opacity_texture: opacity is ``opacity`` times this texture's alpha channel.
    """

    kind: Kind = "diffuse"
    color: Vec3 = (0.5, 0.5, 0.5)
    texture: int = -1
    emission: Vec3 = (0.0, 0.0, 0.0)
    emission_texture: int = -1
    modulation: Modulation | None = None
    emits_behind: bool = True
    back: Back = "same"
    alpha: float = 0.0
    distribution: Distribution = "ggx"
    roughness_texture: int = -1
    metallic: float = 0.0
    ior: float = 1.5
    eta: Vec3 | None = None
    k: Vec3 | None = None
    specular_color: Vec3 = (1.0, 1.0, 1.0)
    specular_tint: float = 0.0
    sheen: float = 0.0
    sheen_tint: float = 0.0
    flatness: float = 0.0
    stretch: float = 1.0
    absorption: Vec3 = (0.0, 0.0, 0.0)
    nonlinear: bool = False
    transmission: float = 0.0
    clearcoat: float = 0.0
    clearcoat_alpha: float = 0.0
    normal_texture: int = -1
    normal_scale: float = 1.0
    bump_texture: int = -1
    bump_scale: float = 1.0
    blend_with: int = -1
    blend_share: float = 0.5
    blend_texture: int = -1
    blend_behind: bool = False
    alpha_mode: AlphaMode = "opaque"
    alpha_cutoff: float = 0.5
    opacity: float = 1.0
    opacity_texture: int = -1
    name: str = ""


TEXTURES = tuple(f"{use}texture" for use in ("", "emission_", "roughness_", "normal_", "opacity_", "bump_", "blend_"))
"""What of a material names a texture."""


@dataclass(frozen=True)
class SphereLight:
    """An analytic spherical emitter; its pose's translation is its centre, ``modulation`` how its light changes."""

    radius_m: float
    radiance: Vec3
    motion: Motion
    name: str = ""
    modulation: Modulation | None = None


@dataclass(frozen=True)
class PunctualLight:
    """A light without size: its pose gives position and direction (it shines along −z, as in glTF).

    Attributes:
        kind: ``point``, ``spot`` or ``directional``.
        intensity: radiant intensity [W·sr⁻¹] of a point or spot, irradiance [W·m⁻²] of a directional light.
        inner_deg, outer_deg: half angles of a spot's cone: full inside, none outside.
        falloff: how a spot fades between them: the ``squared`` ramp of the cosine (glTF), ``linear`` in the angle
            (Mitsuba), or the ``smooth`` step of the cosine, 3x² − 2x³ (pbrt). A ``frame`` is a projector's:
            ``intensity`` along the axis lights a plane across it evenly, within the picture and nowhere else.
        picture: index of a texture by which a spot's intensity is multiplied, −1 for none.
        picture_size: half its width and height at a distance of 1, to the light's right (+x) and up (+y).
        modulation: how its light changes with time.
    """

    kind: Literal["point", "spot", "directional"]
    intensity: Vec3
    motion: Motion
    inner_deg: float = 0.0
    outer_deg: float = 45.0
    falloff: Falloff = "squared"
    name: str = ""
    modulation: Modulation | None = None
    picture: int = -1
    picture_size: tuple[float, float] = (1.0, 1.0)


@dataclass(frozen=True)
class EnvironmentMap:
    """A latitude-longitude image at infinity, on top of the constant environment.

    Attributes:
        radiance: float32 ``[h, w, 3]``; row 0 is +y, column 0…w runs from −z over +x, +z, −x back to −z.
        to_world: 3×3 rotation or reflection from the image's frame to the world, at time 0.
        turn_deg_per_s: how fast it turns about the world's +y, counter-clockwise seen from above.
    """

    radiance: F32
    to_world: Matrix
    turn_deg_per_s: float = 0.0


@dataclass(frozen=True)
class Lens:
    """What makes a camera more than a pinhole.

    Attributes:
        aperture_radius_m: radius of a thin lens; 0 is a pinhole.
        focus_distance_m: distance of the plane in focus.
        model: ``perspective`` with Brown–Conrady ``distortion`` (k1, k2, p1, p2, k3), or ``fisheye``
            (equidistant, Kannala–Brandt) with (k1, k2, k3, k4), as OpenCV defines them; or ``orthographic``, whose rays
            are parallel, begin in the plane of the camera's position, and know neither aperture nor distortion.
        principal_point: offset of the optical centre from the image centre, in image widths, x right and y down.
        mirrored: whether the image is turned over, left for right.
        aspect: focal length along rows over that along columns, in pixels: below 1, pixels are wider than high.
        view_width_m: width of what an orthographic lens sees.
    """

    aperture_radius_m: float = 0.0
    focus_distance_m: float = 1.0
    model: LensModel = "perspective"
    distortion: tuple[float, ...] = ()
    principal_point: tuple[float, float] = (0.0, 0.0)
    mirrored: bool = False
    aspect: float = 1.0
    view_width_m: float = 0.0


@dataclass(frozen=True)
class Camera:
    """A camera; ``fov_deg`` is horizontal, pixels are square unless the lens says otherwise.

    An orthographic lens has no field of view, and ``fov_deg`` is not used.
    """

    width: int
    height: int
    fov_deg: float
    motion: Motion
    shutter_s: float = 0.0
    lens: Lens = field(default_factory=Lens)

    def focal_px(self) -> tuple[float, float]:
        """Return the focal length along rows, negative where the image is mirrored, and along columns [pixels].

        Of an orthographic lens they are pixels per metre.
        """
        fov = math.radians(self.fov_deg)
        if self.lens.model == "orthographic":
            across = self.width / self.lens.view_width_m
        else:
            across = self.width / fov if self.lens.model == "fisheye" else self.width / (2.0 * math.tan(fov / 2.0))
        return -across if self.lens.mirrored else across, across / self.lens.aspect


@dataclass(frozen=True)
class Mount:
    """A camera of a rig: where it sits on the world's camera, which is the rig, and in what it differs from that.

    Attributes:
        name: what it is called.
        offset: 4×4, from its axes to the rig's.
        resolution, fov_deg, lens, shutter_s: its own; None is as the rig's.
    """

    name: str
    offset: Matrix
    resolution: tuple[int, int] | None = None
    fov_deg: float | None = None
    lens: Lens | None = None
    shutter_s: float | None = None

    def camera(self, rig: Camera) -> Camera:
        """Return it as a camera of its own."""
        width, height = self.resolution or (rig.width, rig.height)
        return Camera(
            width,
            height,
            rig.fov_deg if self.fov_deg is None else self.fov_deg,
            Attached(rig.motion, self.offset),
            rig.shutter_s if self.shutter_s is None else self.shutter_s,
            self.lens or rig.lens,
        )


@dataclass(frozen=True)
class Sensor:
    """What the pixel sees: L = ln max(scale·Y, floor), Y the luminance; thresholds in natural-log units.

    ``spectral`` may say that Y is another sum of R, G and B (`clsim.scene.light.spectral`).
    """

    threshold_on: float = 0.2
    threshold_off: float = 0.2
    scale: float = 1.0
    floor: float = 1e-4
    lux_per_unit: float = 100.0
    """Illuminance of the sensor under a luminance of 1 [lux]."""
    spectral: Spectral = "luminance"
    mosaic: Mosaic | None = None
    """What pixels behind colour filters see instead; None where there are none."""


@dataclass(frozen=True)
class World:
    """Everything the renderer needs.

    Attributes:
        rig: the cameras that sit on the world's camera, where there are several.
        environment: radiance of the constant environment; all 0 is no environment.
        environment_modulation: how the light of the environment changes with time, its map's too.
        duration_s: length of the motion; 1 s where nothing moves.
        warnings: what the file asked for and clsim lacks, one sentence each.
        notes: what was decided where the file leaves a choice, one sentence each.
    """

    name: str
    camera: Camera
    meshes: tuple[Mesh, ...] = ()
    instances: tuple[Instance, ...] = ()
    materials: tuple[Material, ...] = ()
    textures: tuple[Texture, ...] = ()
    sphere_lights: tuple[SphereLight, ...] = ()
    punctual_lights: tuple[PunctualLight, ...] = ()
    environment: Vec3 = (0.0, 0.0, 0.0)
    environment_map: EnvironmentMap | None = None
    environment_modulation: Modulation | None = None
    sensor: Sensor = field(default_factory=Sensor)
    fps: float = 120.0
    duration_s: float = 1.0
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    rig: tuple[Mount, ...] = ()

    def motions(self) -> list[Motion]:
        """Return how everything moves rigidly: the camera, instances, sphere lights and punctual lights."""
        placed: tuple[Camera | Instance | SphereLight | PunctualLight, ...]
        placed = (self.camera, *self.instances, *self.sphere_lights, *self.punctual_lights)
        return [each.motion for each in placed]

    def modulations(self) -> list[tuple[str, Modulation]]:
        """Return what of the light changes with time, by name, and how; of materials those that emit."""
        shining: tuple[SphereLight | PunctualLight | Material, ...]
        shining = (*self.sphere_lights, *self.punctual_lights, *(m for m in self.materials if any(m.emission)))
        found = [(each.name or "a lamp", each.modulation) for each in shining if each.modulation is not None]
        if self.environment_modulation is not None:
            found.append(("the environment", self.environment_modulation))
        return found

    def films(self) -> list[tuple[str, Film]]:
        """Return the films on surfaces and of lamps, by the names of their materials or lamps."""
        places = [(each.name, index) for each in self.materials for index in {each.texture, each.emission_texture}]
        places += [(light.name, light.picture) for light in self.punctual_lights]
        found = []
        for name, index in places:
            texture = self.textures[index] if index >= 0 else None
            if isinstance(texture, ImageTexture) and texture.film is not None:
                found.append((name or "a film", texture.film))
        return found

    def light_changes(self) -> bool:
        """Tell whether light changes by itself, whether or not something moves."""
        turns = self.environment_map is not None and self.environment_map.turn_deg_per_s != 0
        return turns or bool(self.modulations() or self.films())

    def light_repeats(self, period_s: float) -> bool:
        """Tell whether light is the same again after that time, as it is at the start."""
        environment = self.environment_map
        turned = 0.0 if environment is None else environment.turn_deg_per_s * period_s / 360.0
        ends = [(change.mean(0.0, 0.0), change.mean(period_s, period_s)) for _, change in self.modulations()]
        films = all(film.shown(0.0, 0.0) == film.shown(period_s, period_s) for _, film in self.films())
        return films and abs(turned - round(turned)) < 1e-6 and all(np.allclose(*both, atol=1e-6) for both in ends)

    def moving_s(self) -> float:
        """Return the length of the longest motion, deformation or change of light [s]; 0 where there is none."""
        lengths_s = [mesh.deformation.duration_s for mesh in self.meshes if mesh.deformation is not None]
        lengths_s += [modulation.duration_s for _, modulation in self.modulations()]
        lengths_s += [film.duration_s for _, film in self.films()]
        return max(*(motion.duration_s for motion in self.motions()), *lengths_s, 0.0)


IDENTITY = Static(np.eye(4))
