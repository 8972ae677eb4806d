"""Mitsuba's ``principled``, which is Disney's model."""

from __future__ import annotations

import math
from collections.abc import Callable

from clsim.scene.mitsuba.textures import TextureReader, luminance
from clsim.scene.mitsuba.xml import Plugin
from clsim.scene.world import Material

LEAST_IOR = 1.001
"""As in Mitsuba, an index of 1, with which glass would be nothing, is a little more."""
LEAST_ALPHA = 0.001
DULL_COAT, GLOSSY_COAT = 0.1, 0.001


def read_principled(bsdf: Plugin, textures: TextureReader, warn: Callable[[str], None]) -> Material:
    """Return the material; textures are those of its colour and roughness, others give their mean and a warning."""

    def share(name: str, default: float) -> float:
        return min(max(luminance(textures.color(bsdf, name, default, plain=True)[0]), 0.0), 1.0)

    color, texture = textures.color(bsdf, "base_color", 0.5)
    r, g, b = (min(max(channel, 0.0), 1.0) for channel in color)
    alpha, rough = 1.0, bsdf.child("roughness")
    roughness_texture = -1
    if rough is not None:
        roughness_texture = textures.roughness(textures.index(rough, number=True), perceptual=True)
    else:
        alpha = max(share("roughness", 0.5) ** 2, LEAST_ALPHA)
    ior = bsdf.get("eta", 1.5)
    if "specular" in bsdf.values:
        ior = 2.0 / (1.0 - math.sqrt(0.08 * min(max(bsdf.get("specular", 0.5), 1e-3), 1.0))) - 1.0
    elif ior < LEAST_IOR:
        if ior < 1.0:
            warn(f"the eta of a bsdf principled is {ior:g}; 1 stands in, for it must be denser than air")
        ior = LEAST_IOR
    return Material(
        kind="disney",
        color=(r, g, b),
        texture=texture,
        back="black",
        alpha=alpha,
        roughness_texture=roughness_texture,
        stretch=1.0 / math.sqrt(1.0 - 0.9 * share("anisotropic", 0.0)),
        metallic=share("metallic", 0.0),
        ior=ior,
        transmission=share("spec_trans", 0.0),
        specular_tint=share("spec_tint", 0.0),
        sheen=share("sheen", 0.0),
        sheen_tint=share("sheen_tint", 0.0),
        flatness=share("flatness", 0.0),
        clearcoat=share("clearcoat", 0.0),
        clearcoat_alpha=DULL_COAT + (GLOSSY_COAT - DULL_COAT) * share("clearcoat_gloss", 0.0),
    )
