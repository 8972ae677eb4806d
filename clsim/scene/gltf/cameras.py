"""glTF cameras (glTF 2.0, section 3.10)."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from clsim.scene.defaults.framing import RESOLUTION, orthographic_camera
from clsim.scene.gltf import schema
from clsim.scene.motion import Matrix, Motion
from clsim.scene.world import Camera


def camera_of(camera: schema.Camera, matrix: Matrix, motion: Motion, warn: Callable[[str], None]) -> Camera | None:
    """Return a camera; None, with a warning, where it is of no kind that clsim has, or sees nothing.

    Args:
        camera: what the file says.
        matrix: from its node to the world at the start, whose scale an orthographic view has.
        motion: how it moves.
        warn: takes why it is left out.
    """
    flat = camera.orthographic
    if camera.type == "orthographic" and flat is not None:
        across, up, _ = np.linalg.norm(matrix[:3, :3], axis=0) * (flat.xmag, flat.ymag, 1.0)
        if 0 < abs(across) < math.inf and 0 < abs(up) < math.inf:
            return orthographic_camera(RESOLUTION[0], 2.0 * abs(across), 2.0 * abs(up), motion)
        warn("an orthographic camera that sees no area is left out")
        return None
    if camera.type != "perspective" or camera.perspective is None:
        warn(f"cameras of type {camera.type} are left out")
        return None
    lens, (width, height) = camera.perspective, RESOLUTION
    if lens.aspectRatio is not None:
        height = max(1, min(round(width / lens.aspectRatio), 16384))
    fov_deg = 2 * math.degrees(math.atan(math.tan(lens.yfov / 2) * (lens.aspectRatio or width / height)))
    return Camera(width, height, fov_deg, motion)
