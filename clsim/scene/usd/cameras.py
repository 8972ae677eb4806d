"""Cameras of a USD file."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom

from clsim.scene.defaults.framing import RESOLUTION, orthographic_camera
from clsim.scene.motion import Motion
from clsim.scene.usd.stage import PrimError, Stage
from clsim.scene.world import Camera, Lens

_FIXED = ("focalLength", "horizontalAperture", "verticalAperture", "fStop", "focusDistance")


def read_camera(stage: Stage, prim: Any, motion: Motion) -> Camera:
    """Return a ``UsdGeomCamera`` that moves so; its lens is that of the start.

    Raises:
        PrimError: it has no size.
    """
    source = UsdGeom.Camera(prim).GetCamera(Usd.TimeCode(stage.start))
    across, up, focal = source.horizontalAperture, source.verticalAperture, source.focalLength
    if not all(0 < size < 1e9 for size in (across, up, focal)):
        raise PrimError(f"{stage.path}: {prim.GetPath()} has an aperture or a focal length that is not positive")
    for name in _FIXED:
        stage.still(prim.GetAttribute(name))
    if stage.value(prim.GetAttribute("exposure")):
        stage.warn(f"exposure of cameras is left out (first {prim.GetName()})")
    width = RESOLUTION[0]
    if str(source.projection).endswith("Orthographic"):
        if source.horizontalApertureOffset or source.verticalApertureOffset:
            stage.warn(f"offsets of orthographic cameras are left out (first {prim.GetName()})")
        # Apertures are in tenths of the file's unit, as seen from within the camera.
        scale = np.linalg.norm(stage.to_world(prim, stage.start)[:3, :2], axis=0) / 10
        return orthographic_camera(width, across * scale[0], up * scale[1], motion)
    lens = Lens(principal_point=(-source.horizontalApertureOffset / across, source.verticalApertureOffset / across))
    if source.fStop > 0 and source.focusDistance > 0:
        # Focal lengths are in tenths of the file's unit.
        radius_m = focal / 10 * stage.metres / source.fStop / 2
        lens = replace(lens, aperture_radius_m=radius_m, focus_distance_m=source.focusDistance * stage.metres)
    height = max(1, min(round(width * up / across), 16384))
    fov_deg = 2 * math.degrees(math.atan(across / 2 / focal))
    return Camera(width, height, fov_deg, motion, lens=lens)
