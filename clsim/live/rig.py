"""Several cameras on one rig: a run for each, over one scene on the device."""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from clsim.errors import InputError
from clsim.events.sockets.address import is_address
from clsim.live.options import LiveOptions
from clsim.live.session import RigMember, Session, open_live
from clsim.live.stages import Stages, load_options_world
from clsim.scene import Camera, World, validate
from clsim.scene.world import Mount

if TYPE_CHECKING:
    from clsim.frames import InterestBoard
    from clsim.render import SceneData, View

PLACEHOLDER = "{camera}"
"""Stands for the camera's name in the names of outputs."""
_GOLDEN = 0x9E3779B97F4A7C15
"""Far from the small seeds that people choose, whatever multiple of it is added."""


class SharedScene:
    """The scene of a rig on the device, copied there when the first camera asks."""

    def __init__(self, world: World, interval_s: float) -> None:
        """Keep the world; ``interval_s`` is the longest exposure of the cameras."""
        self._world, self._interval_s = world, interval_s
        self._lock = threading.Lock()
        self._data: SceneData | None = None

    def view(self, stages: Stages, board: InterestBoard | None) -> View:
        """Return a camera's view of it; they render one at a time (`SceneData.lock`)."""
        from clsim.render import SceneData, View

        with self._lock:
            if self._data is None:
                render = stages.render
                self._data = SceneData(
                    self._world, render.device, render.tree, self._interval_s, light_cache=render.light_cache
                )
            return View(self._data, stages.render, board, stages.world.camera)


def open_rig(options: LiveOptions) -> list[Session]:
    """Open a run for each camera of a scene, by the names that ``{camera}`` in the outputs stands for.

    A scene without a rig has one camera, and its outputs are as they are named.

    Raises:
        InputError: as `open_live`; or the outputs of two cameras would be one.
    """
    world = load_options_world(options)
    if not world.rig:
        return [open_live(options)]
    for name in options.outputs:
        if PLACEHOLDER not in name:
            kind = "an address" if is_address(name) else "a file"
            raise InputError(
                f"{name}: is {kind} for each of the cameras {', '.join(mount.name for mount in world.rig)}; expected "
                f"{PLACEHOLDER} in its name"
            )
    cameras = cameras_of(world)
    shared = SharedScene(world, max(camera.shutter_s for camera in cameras.values()))
    sessions: list[Session] = []
    try:
        for number, mount in enumerate(world.rig):
            own = replace(world, camera=cameras[mount.name], rig=())
            outputs = tuple(name.replace(PLACEHOLDER, mount.name) for name in options.outputs)
            facts = {"camera_name": mount.name, "extrinsics": extrinsics(mount, world.rig)}
            member = RigMember(own, shared.view, facts)
            chip = replace(options, outputs=outputs, seed=seed_of(options.seed, number))
            sessions.append(open_live(chip, told={"seed": options.seed}, member=member))
    except BaseException:
        for session in sessions:
            session.pipeline.stop()
        raise
    return sessions


def seed_of(seed: int, number: int) -> int:
    """Return the seed of a camera of a rig, by its number from 0: the first has the run's, others their own noise."""
    return (seed + number * _GOLDEN) % 2**64


def cameras_of(world: World) -> dict[str, Camera]:
    """Return the cameras of a rig, by name.

    Raises:
        InputError: one of them cannot be.
    """
    cameras = {mount.name: mount.camera(world.camera) for mount in world.rig}
    for name, camera in cameras.items():
        validate(replace(world, camera=camera, rig=()), f"{world.name}: camera {name}")
    return cameras


def extrinsics(mount: Mount, rig: tuple[Mount, ...]) -> dict[str, list[list[float]]]:
    """Return from a camera's axes to those of each other's, ``[4, 4]``, with +z ahead and +y down (OpenCV's)."""
    axes = np.diag((1.0, -1.0, -1.0, 1.0))
    return {
        other.name: (axes @ np.linalg.inv(other.offset) @ mount.offset @ axes).tolist()
        for other in rig
        if other.name != mount.name
    }


def run_all(sessions: list[Session]) -> None:
    """Run all to the end; if one of them cannot go on, none does.

    Raises:
        SinkError: an output failed on the way; the others are complete.
        BaseException: whatever ended the runs, Ctrl-C for one; all outputs are closed then.
    """
    try:
        for session in sessions:
            session.start()
        running = sessions
        while running:  # polled: one may fail while another would run for ever
            running = [session for session in running if not session.pipeline.wait(0.1)]
    except BaseException:
        for session in sessions:
            session.pipeline.stop()
            session.write_sidecars(complete=False)
        raise
    for session in sessions:
        session.write_sidecars(complete=True)
    for session in sessions:
        session.raise_failures()
