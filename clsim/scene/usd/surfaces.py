"""Surface shaders of USD that are read as UsdPreviewSurface: by what names they tell the same, and what else they tell.

Those of MaterialX are its standard surface (1.0.1), OpenPBR (1.1) and glTF's, whose parameters' names and defaults are
in their own specifications.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from pxr import UsdShade

from clsim.scene.world import Vec3

LUMENS_PER_WATT = 683.0
CONTEXTS = ("", "mtlx")
"""Where materials name their surfaces: for any renderer, and by MaterialX."""


@dataclass(frozen=True)
class SurfaceModel:
    """How a shader tells what UsdPreviewSurface tells.

    Attributes:
        names: its names of inputs, by those of UsdPreviewSurface and those that only others have: ``transmission``,
            ``baseWeight``, ``specularWeight``, ``specularTint``, ``emissionWeight``, ``transmissionColor``,
            ``thinWalled``, ``coatColor``, which tints what lies below the coat, and ``alphaMode``, which is 0 for
            opaque surfaces, 1 for cut and 2 for blended ones.
        color, metallic, roughness: what these inputs are where the file tells nothing.
        ior, clearcoat_roughness, emission: likewise; ``emission`` is the weight of what it sends out.
        cutoff: likewise, the opacity below which surfaces are cut.
        unread: numbers and colours that clsim cannot show, which are 0 where they are not used.
        nits: whether light is told in cd/m².
    """

    names: dict[str, str]
    color: Vec3 = (0.18, 0.18, 0.18)
    metallic: float = 0.0
    roughness: float = 0.5
    ior: float = 1.5
    clearcoat_roughness: float = 0.01
    emission: float = 1.0
    emissive: Vec3 = (0.0, 0.0, 0.0)
    cutoff: float = 0.0
    unread: tuple[str, ...] = field(default=())
    nits: bool = False


_PREVIEW = (
    *("diffuseColor", "emissiveColor", "specularColor", "metallic", "roughness", "opacity", "normal"),
    *("useSpecularWorkflow", "ior", "clearcoat", "clearcoatRoughness", "opacityThreshold"),
)
PREVIEW = SurfaceModel({name: name for name in _PREVIEW}, unread=("displacement",))
_STANDARD = SurfaceModel(
    {
        "diffuseColor": "base_color",
        "baseWeight": "base",
        "metallic": "metalness",
        "roughness": "specular_roughness",
        "ior": "specular_IOR",
        "specularWeight": "specular",
        "specularTint": "specular_color",
        "transmissionColor": "transmission_color",
        "thinWalled": "thin_walled",
        "clearcoat": "coat",
        "coatColor": "coat_color",
        "clearcoatRoughness": "coat_roughness",
        "transmission": "transmission",
        "emissiveColor": "emission_color",
        "emissionWeight": "emission",
        "opacity": "opacity",
        "normal": "normal",
    },
    color=(0.8, 0.8, 0.8),
    roughness=0.2,
    clearcoat_roughness=0.1,
    emission=0.0,
    emissive=(1.0, 1.0, 1.0),
    unread=(
        *("sheen", "subsurface", "thin_film_thickness", "specular_anisotropy", "coat_anisotropy"),
        *("diffuse_roughness", "transmission_depth", "transmission_scatter", "transmission_dispersion"),
    ),
)
_OPEN_PBR = SurfaceModel(
    {
        "diffuseColor": "base_color",
        "baseWeight": "base_weight",
        "metallic": "base_metalness",
        "roughness": "specular_roughness",
        "ior": "specular_ior",
        "specularWeight": "specular_weight",
        "specularTint": "specular_color",
        "transmissionColor": "transmission_color",
        "thinWalled": "geometry_thin_walled",
        "clearcoat": "coat_weight",
        "coatColor": "coat_color",
        "clearcoatRoughness": "coat_roughness",
        "transmission": "transmission_weight",
        "emissiveColor": "emission_color",
        "emissionWeight": "emission_luminance",
        "opacity": "geometry_opacity",
        "normal": "geometry_normal",
    },
    color=(0.8, 0.8, 0.8),
    roughness=0.3,
    clearcoat_roughness=0.0,
    emission=0.0,
    emissive=(1.0, 1.0, 1.0),
    unread=(
        *("fuzz_weight", "subsurface_weight", "thin_film_weight", "specular_roughness_anisotropy"),
        *("base_diffuse_roughness", "transmission_depth", "transmission_scatter"),
    ),
    nits=True,
)
_GLTF = SurfaceModel(
    {
        "diffuseColor": "base_color",
        "metallic": "metallic",
        "roughness": "roughness",
        "ior": "ior",
        "specularWeight": "specular",
        "specularTint": "specular_color",
        "clearcoat": "clearcoat",
        "clearcoatRoughness": "clearcoat_roughness",
        "transmission": "transmission",
        "emissiveColor": "emissive",
        "emissionWeight": "emissive_strength",
        "opacity": "alpha",
        "alphaMode": "alpha_mode",
        "opacityThreshold": "alpha_cutoff",
        "normal": "normal",
    },
    color=(1.0, 1.0, 1.0),
    metallic=1.0,
    roughness=1.0,
    clearcoat_roughness=0.0,
    cutoff=0.5,
    unread=("iridescence", "sheen_color", "thickness"),
)
MODELS = {
    "UsdPreviewSurface": PREVIEW,
    "ND_UsdPreviewSurface_surfaceshader": PREVIEW,
    "ND_standard_surface_surfaceshader": _STANDARD,
    "ND_open_pbr_surface_surfaceshader": _OPEN_PBR,
    "ND_gltf_pbr_surfaceshader": _GLTF,
}


def material_of(prim: Any) -> Any:
    """Return the material of a prim, that of final pictures before that of previews where clsim can read it."""
    binding = UsdShade.MaterialBindingAPI(prim)
    found = [binding.ComputeBoundMaterial(purpose)[0] for purpose in (UsdShade.Tokens.full, UsdShade.Tokens.preview)]
    bound = [each for each in found if each]
    return next((each for each in bound if surface_of(each)), bound[0] if bound else found[0])


def surface_of(bound: Any) -> tuple[Any, SurfaceModel] | None:
    """Return the shader of a material's surface and how it is read; None where it is of no kind that clsim knows."""
    for context in CONTEXTS:
        source = bound.ComputeSurfaceSource(context)
        shader = source[0] if isinstance(source, tuple) else source
        model = MODELS.get(str(shader.GetIdAttr().Get())) if shader else None
        if model is not None:
            return shader, model
    return None
