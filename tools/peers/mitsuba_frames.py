"""Mitsuba 3 as a source of frames: the same scene, camera path, path depth and planes, with noise of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from clsim.errors import InputError
from clsim.frames import ALBEDO, DEPTH, NORMAL, RADIANCE, Frame, frame_time_us
from clsim.render import RenderOptions
from clsim.render.sampling.sampling import stream_state
from clsim.scene import Lens, World
from tools.peers.mitsuba_files import load_mitsuba_file
from tools.peers.mitsuba_scene import camera_pose, check_plain, mitsuba_scene, move_scene
from tools.peers.mitsuba_variant import load_mitsuba

_PLANES = {RADIANCE: "", ALBEDO: "albedo:albedo", NORMAL: "normal:sh_normal", DEPTH: "depth:depth"}
"""Planes in the order of Mitsuba's channels, and the arbitrary output variables that hold them."""


class MitsubaFrames:
    """Renders with Mitsuba 3, LLVM; a ``clsim.frames.FrameSource``.

    Every frame has noise of its own, as a user's frames have who calls a renderer frame by frame. Albedo, shading
    normal and depth are of the first hit.
    """

    names = RADIANCE + ALBEDO + NORMAL + DEPTH

    def __init__(self, world: World, file: Path | None, options: RenderOptions) -> None:
        """Load the scene: from Mitsuba's own ``file`` where the world came from one, else as ``world`` has it.

        Raises:
            InputError: Mitsuba is missing, cannot read the file, or the world has what this translation lacks.
        """
        mitsuba = require_mitsuba(world, file)
        camera = world.camera
        self.width, self.height = camera.width, camera.height
        self.frame_count = options.frames
        self._mitsuba, self._world, self._options = mitsuba, world, options
        self._translated = file is None
        if file:
            self._scene = load_mitsuba_file(mitsuba, file)
        else:
            self._scene = mitsuba_scene(mitsuba, world, options.max_depth)
        path = {"type": "path", "max_depth": options.max_depth, "rr_depth": options.roulette_start}
        aovs = ",".join(name for name in _PLANES.values() if name)
        self._integrator = mitsuba.load_dict({"type": "aov", "aovs": aovs, "image": path})
        film = {"type": "hdrfilm", "width": camera.width, "height": camera.height, "pixel_format": "rgb"}
        self._sensor = mitsuba.load_dict(
            {
                "type": "perspective",
                "fov": camera.fov_deg,
                "fov_axis": "x",
                "near_clip": 1e-3,
                "to_world": mitsuba.ScalarTransform4f(camera_pose(world, 0.0)),
                "film": film | {"rfilter": {"type": "box"}},
                "sampler": {"type": "independent"},
            }
        )
        self._pose = mitsuba.traverse(self._sensor)

    def fill(self, index: int, out: Frame) -> None:
        """Render frame ``index`` into ``out``."""
        fps = self._options.fps or self._world.fps
        out.time_us, out.index = frame_time_us(index, fps), index
        time_s = out.time_us * 1e-6
        self._pose["to_world"] = self._mitsuba.Transform4f(camera_pose(self._world, time_s))
        self._pose.update()
        if self._translated:
            move_scene(self._mitsuba, self._scene, self._world, time_s)
        seed = stream_state(self._options.seed, index) & 0xFFFFFFFF
        image = self._mitsuba.render(
            self._scene, sensor=self._sensor, integrator=self._integrator, spp=self._options.spp, seed=seed
        )
        out.planes[...] = np.moveaxis(np.array(image), -1, 0)

    def close(self) -> None:
        """Release nothing; here so that all sources end alike."""


def require_mitsuba(world: World, file: Path | None) -> Any:
    """Return Mitsuba if it can render the world, read from Mitsuba's own ``file`` or handed over.

    Raises:
        InputError: it is not installed or does not work here, or the world has what cannot be handed over.
    """
    mitsuba = load_mitsuba()
    if world.camera.lens != Lens() or world.camera.shutter_s > 0:
        raise InputError(f"{world.name}: a lens or an exposure time is not handed to Mitsuba, expected a pinhole")
    if file is None:
        check_plain(world)
    return mitsuba
