"""Truth of a live run: from its options to recorders of the layouts among its outputs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from clsim.live.outputs.sidecars import about_camera
from clsim.live.pacing.schedule import Schedule
from clsim.live.settings import OutputSettings
from clsim.scene import World
from clsim.truth.imu_file import read_imu_noise
from clsim.truth.layouts import check_place, layout_of, open_layout
from clsim.truth.motions import Motions
from clsim.truth.record import About
from clsim.truth.recorder import Plan, TruthRecorder
from clsim.truth.world_facts import material_names, object_motions, object_names, poses_at_start


def recorder_openers(
    options: OutputSettings, seed: int, world: World, schedule: Schedule, about: dict[str, Any], every: int
) -> dict[str, Callable[[str], TruthRecorder]]:
    """Return, for each output that takes truth, what opens it at a place; raises InputError where one could not be."""
    if not options.truth:
        return {}
    names = [name for name in options.outputs if layout_of(name) is not None]
    for name in names:
        check_place(name)
    plan = _plan(options, seed, world, schedule, about, every)
    return dict.fromkeys(names, lambda place: TruthRecorder(plan, open_layout(place, plan.about)))


def _plan(
    options: OutputSettings, seed: int, world: World, schedule: Schedule, more: dict[str, Any], every: int
) -> Plan:
    objects = object_names(world)
    named = zip(objects, object_motions(world), strict=True)
    moving = tuple((name, motion) for name, motion in named if motion.duration_s > 0)
    about = About(
        width=world.camera.width,
        height=world.camera.height,
        camera=about_camera(world.camera),
        names=options.truth,
        frame_rate=schedule.fps / every,
        objects=objects,
        materials=material_names(world),
        object_poses=poses_at_start(world),
        moving=tuple(name for name, _ in moving),
        imu_rate=options.imu_rate,
        camera_name=more.get("camera_name", "camera"),
        extrinsics={name: np.array(matrix) for name, matrix in more.get("extrinsics", {}).items()},
        more=more,
    )
    if options.imu_noise is not None:
        about = replace(about, imu_noise=read_imu_noise(options.imu_noise))
    motions = Motions(about, world.camera.motion, moving, options.pose_rate, seed)
    return Plan(about, every, schedule.time_us, motions)
