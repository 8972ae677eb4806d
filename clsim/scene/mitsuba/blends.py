"""Blends of two materials, as Mitsuba's blendbsdf and pbrt's mix are, and whether there are textures in one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from clsim.scene.world import Material


def is_textured(material: Material, materials: Sequence[Material]) -> bool:
    """Tell whether a material has a texture, or one of ``materials`` of which it is a blend has."""
    colors = max(material.texture, material.emission_texture, material.opacity_texture, material.blend_texture)
    if max(colors, material.roughness_texture, material.normal_texture, material.bump_texture) >= 0:
        return True
    return material.blend_with >= 0 and is_textured(materials[material.blend_with], materials)


def blended(
    first: Material,
    second: Material,
    share: float,
    texture: int,
    added: Callable[[Material], int],
    warn: Callable[[str], None],
) -> Material:
    """Return a blend.

    Args:
        first: one material.
        second: the other.
        share: how much of the other there is, 0 to 1.
        texture: index of the texture that this share is multiplied by; -1 for none.
        added: takes a material among those of the world, and returns its index.
        warn: takes what is lost.
    """
    if {first.alpha_mode, second.alpha_mode} != {"opaque"}:
        if max(first.opacity_texture, second.opacity_texture, texture) >= 0:
            warn("masks within a blend that are textures, or whose weight is one, take those of the first")
        else:
            opacity = (1.0 - share) * first.opacity + share * second.opacity
            share = share * second.opacity / max(opacity, 1e-9)
            first = replace(first, alpha_mode="blend", opacity=opacity)
    if first.blend_with >= 0:
        if second.blend_with >= 0 or texture >= 0:
            warn("of a blend within a blend, the first material stands in")
            first = replace(first, blend_with=-1)
        else:
            first, second, share = second, first, 1.0 - share
    return replace(first, blend_with=added(second), blend_share=share, blend_texture=texture)
