"""How other renderers name the channels of their EXR files, and which plane of a Frame each one is.

A layout is recognised by its channels alone:

=============  ==========================================================================================
``planes``     ours and the ICIP 2023 program's: channel names are plane names; also bare R, G, B, or such a
               layer or part called rgba, rgb, beauty or C
``pbrt``       pbrt-v4's GBufferFilm: P.X…, Ns.X… or N.X…, Albedo.R…; no depth, but positions
``mitsuba``    Mitsuba 3's aov integrator: <name>.T is depth, <name>.X/Y/Z normals, <name>.R/G/B colours
``blender``    Blender's multilayer files: <layer>.Combined.R…, .Depth.Z, .Normal.X…, .DiffCol.R…; since
               5.0 ``Diffuse Color`` instead of ``DiffCol``, and one part a pass
=============  ==========================================================================================
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal

from clsim.errors import InputError
from clsim.frames.planes import ALBEDO, COVERAGE, DEPTH, NORMAL, RADIANCE, rendered_planes

MissMark = Literal["none", "zero depth", "far depth", "zero position"]
FAR_M = 1e9
"""Blender writes this depth or more where nothing was hit."""
POSITION = ("Position.X", "Position.Y", "Position.Z")
"""Pseudo-planes of a layout that has positions instead of depth."""
_FILE_PLANES = rendered_planes(first_hit_rays=True, variances=True).names
"""Every plane that a file may give."""


@dataclass(frozen=True)
class Layout:
    """Where the planes of a frame lie in a file.

    Attributes:
        name: ``planes``, ``pbrt``, ``mitsuba`` or ``blender``.
        channels: file channel of each plane (and of `POSITION`).
        miss: how the file marks pixels that hit nothing; a coverage plane of 0 and 1 is made of it.
    """

    name: str
    channels: Mapping[str, str] = field(default_factory=dict)
    miss: MissMark = "none"

    @property
    def has_position(self) -> bool:
        """Whether depth may be had from positions."""
        return POSITION[0] in self.channels

    def planes(self, with_depth: bool) -> tuple[str, ...]:
        """Return the planes that a file gives, in the order of frames; ``with_depth``: from positions too."""
        have = set(self.channels)
        if self.has_position and with_depth:
            have |= set(DEPTH)
        if self.miss == "zero position" or (self.miss != "none" and DEPTH[0] in have):
            have |= set(COVERAGE)
        return tuple(name for name in _FILE_PLANES if name in have)


def recognise(channels: Iterable[str], file: str) -> Layout:
    """Tell the layout from a file's channel names (of a multi-part file: ``part.channel``).

    Raises:
        InputError: no layout gives radiance, or the names are ambiguous.
    """
    names = set(channels)
    for find in (_blender, _pbrt, _mitsuba, _planes, _layer):
        layout = find(names, file)
        if layout is not None:
            return layout
    shown = ", ".join(sorted(names)[:12]) or "none"
    raise InputError(f"{file} has no radiance that a known layout names (R, G, B or *.Combined.R…): channels {shown}")


def _planes(names: set[str], file: str) -> Layout | None:
    if not set(RADIANCE) <= names:
        return None
    return Layout("planes", {name: name for name in _FILE_PLANES if name in names})


def _layer(names: set[str], file: str) -> Layout | None:
    groups = sorted(name[:-2] for name in names if name.endswith(".R") and _all(names, name[:-2], "RGB"))
    found = [group for group in groups if group.rpartition(".")[2].lower() in ("rgba", "rgb", "beauty", "c")]
    return Layout("planes", _triple(RADIANCE, _only(found, "picture", file), "RGB")) if found else None


def _pbrt(names: set[str], file: str) -> Layout | None:
    position = ("P.X", "P.Y", "P.Z")
    if not {*RADIANCE, *position} <= names or not ({"dzdx", "Ns.X", "N.X"} & names):
        return None
    # Variance.* is of one sample there, not of the mean: it is left out.
    channels = {name: name for name in RADIANCE + ALBEDO if name in names}
    for group in ("Ns", "N"):
        if f"{group}.X" in names:
            channels |= _triple(NORMAL, group, "XYZ")
            break
    channels |= dict(zip(POSITION, position, strict=True))
    return Layout("pbrt", channels, "zero position")


def _mitsuba(names: set[str], file: str) -> Layout | None:
    vectors = sorted(name[:-2] for name in names if name.endswith(".X") and _all(names, name[:-2], "XYZ"))
    depths = sorted(name for name in names if name.endswith(".T"))
    colours = sorted(name[:-2] for name in names if name.endswith(".R") and _all(names, name[:-2], "RGB"))
    if not depths and not vectors:
        return None
    albedos = [group for group in colours if "alb" in group.lower()]
    images = [group for group in colours if group not in albedos]
    if set(RADIANCE) <= names:
        channels = {name: name for name in RADIANCE}
    elif images:
        channels = _triple(RADIANCE, _only(images, "image", file), "RGB")
    else:
        return None
    shading = [g for g in vectors if re.search(r"sh", g, re.IGNORECASE)]
    normals = shading or [g for g in vectors if re.search(r"^n|norm", g, re.IGNORECASE)]
    if normals:
        channels |= _triple(NORMAL, _only(normals, "normal", file), "XYZ")
    if depths:
        channels[DEPTH[0]] = _only(depths, "depth", file)
    if albedos:
        channels |= _triple(ALBEDO, _only(albedos, "albedo", file), "RGB")
    return Layout("mitsuba", channels, "zero depth" if depths else "none")


def _blender(names: set[str], file: str) -> Layout | None:
    layers = sorted(name[: -len("Combined.R")] for name in names if re.search(r"(^|\.)Combined\.R$", name))
    if not layers:
        return None
    layer = _only(layers, "view layer", file)
    channels = _triple(RADIANCE, f"{layer}Combined", "RGB")
    if f"{layer}Depth.Z" in names:
        channels[DEPTH[0]] = f"{layer}Depth.Z"
    if _all(names, f"{layer}Normal", "XYZ"):
        channels |= _triple(NORMAL, f"{layer}Normal", "XYZ")
    for albedo in ("Denoising Albedo", "DiffCol", "Diffuse Color"):
        if _all(names, layer + albedo, "RGB"):
            channels |= _triple(ALBEDO, layer + albedo, "RGB")
            break
    return Layout("blender", channels, "far depth" if DEPTH[0] in channels else "none")


def _triple(planes: tuple[str, ...], group: str, suffixes: str) -> dict[str, str]:
    return {plane: f"{group}.{suffix}" for plane, suffix in zip(planes, suffixes, strict=True)}


def _all(names: set[str], group: str, suffixes: str) -> bool:
    return all(f"{group}.{suffix}" in names for suffix in suffixes)


def _only(groups: list[str], what: str, file: str) -> str:
    if len(groups) > 1:
        raise InputError(f"{file} has more than one {what}: {', '.join(g.strip('.') for g in groups)}; expected one")
    return groups[0]
