"""How exact times are, in pixels: the named qualities on a straight edge whose events are known in closed form."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from time import process_time
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from clsim.bench.tradeoff.measure import run_point
from clsim.bench.tradeoff.settings import named_points
from clsim.events import EventBatch
from clsim.live.options import LiveOptions
from clsim.live.pacing.time_steps import check_time
from clsim.live.quality import Quality
from clsim.live.stages import plan_stages
from clsim.opencl.device import choose_device
from clsim.scene import Camera, ImageTexture, Instance, Material, Mesh, World, load_world
from clsim.scene.motion import Keyframes, Motion
from clsim.score.matching import Sampling, one_to_one
from clsim.score.score import harmonic
from clsim.score.straight_edge import Edge
from clsim.simulator import Simulator

Kind = Literal["geometric", "albedo", "ramp"]
KINDS: tuple[Kind, ...] = ("geometric", "albedo", "ramp")
QUALITIES: tuple[Quality, ...] = ("draft", "balanced", "accurate")
SPEEDS_PX_S = (30.0, 300.0, 3000.0)
RAMP_PX = 4.0
_MOST_FRAMES = 24
_PICTURE = 0.8
"""The edge goes through so much of the picture's width at most."""
_DARK = 64
"""Texel of the dark side, of 255."""


@dataclass(frozen=True)
class EdgeScene:
    """A world with a straight edge, what its pixels see in closed form, and how many frames the edge is followed."""

    world: World
    edge: Edge
    frames: int


def edge_scene(kind: Kind, speed_px_s: float, width: int, height: int, fps: float) -> EdgeScene:
    """Return a variant of the bundled scene ``edge``, at the speed given, its edge amid the picture at half time.

    ``geometric`` is the bundled panel before the wall, ``albedo`` two colours on one sheet in even light, ``ramp`` the
    same with a linear transition of ``RAMP_PX`` instead of a step.
    """
    world = load_world("edge", resolution=(width, height))
    panel = world.instances[1]
    start, end = panel.motion.pose(0.0), panel.motion.pose(panel.motion.duration_s)
    normal, from_px = _line(world.camera, world.meshes[panel.mesh], start)
    _, to_px = _line(world.camera, world.meshes[panel.mesh], end)
    frames = max(3, min(_MOST_FRAMES, round(_PICTURE * width * fps / speed_px_s)))
    travel_px = speed_px_s * (frames - 1) / fps
    offset_px = normal @ [width / 2, height / 2] - travel_px / 2

    turned = panel.motion
    assert isinstance(turned, Keyframes)
    edges_px = np.array([[offset_px], [offset_px + travel_px]])
    places = start[:3, 3] + (end - start)[:3, 3] * (edges_px - from_px) / (to_px - from_px)
    positions = tuple((float(x), float(y), float(z)) for x, y, z in places)
    motion = Keyframes((0.0, (frames - 1) / fps), positions, turned.rotations[:2])
    wall, dark = (world.materials[int(world.meshes[i.mesh].material_ids[0])].emission[0] for i in world.instances)
    edge = Edge((float(normal[0]), float(normal[1])), float(offset_px), speed_px_s, dark, wall)
    if kind == "geometric":
        return EdgeScene(replace(world, instances=(world.instances[0], replace(panel, motion=motion))), edge, frames)
    ramp_px = RAMP_PX if kind == "ramp" else 0.0
    edge = replace(edge, behind=_DARK / 255, ahead=1.0, ramp_px=ramp_px)
    return EdgeScene(_sheet(world, motion, ramp_px), edge, frames)


def _focal_px(camera: Camera) -> float:
    return camera.width / 2 / math.tan(math.radians(camera.fov_deg) / 2)


def _line(camera: Camera, panel: Mesh, pose: npt.NDArray[np.float64]) -> tuple[npt.NDArray[np.float64], float]:
    """Return the unit normal (right, down) and the offset of the panel's right side in the picture [px]."""
    side = panel.vertices[[1, 2]].astype(np.float64) @ pose[:3, :3].T + pose[:3, 3]
    view = camera.motion.pose(0.0)
    seen = (side - view[:3, 3]) @ view[:3, :3]
    focal = _focal_px(camera)
    points = seen[:, :2] / -seen[:, 2:] * [focal, -focal] + [camera.width / 2, camera.height / 2]
    along = points[1] - points[0]
    normal = np.array([-along[1], along[0]]) / np.hypot(*along)
    return normal, float(normal @ points[0])


def _sheet(world: World, motion: Motion, ramp_px: float) -> World:
    """Return the world with one sheet in place of wall and panel, dark where the panel was, in even light."""
    panel = world.meshes[world.instances[1].mesh]
    side_m = float(panel.vertices[1, 0])
    distance_m = float(world.camera.motion.pose(0.0)[2, 3])
    # Between the centres of its two texels, a quarter and three quarters of u, an image goes over linearly.
    ramp_m = ramp_px * distance_m / _focal_px(world.camera) if ramp_px else 1.0
    vertices = panel.vertices + (panel.vertices[:, :1] > 0) * np.array([2 * side_m, 0, 0], np.float32)
    u = 0.5 + (vertices[:, 0] - side_m) / (2 * ramp_m)
    uvs = np.column_stack([u, np.full(len(u), 0.5)]).astype(np.float32)
    texels = np.full((1, 2, 4), 255, np.uint8)
    texels[0, 0, :3] = _DARK
    texture = ImageTexture(texels, srgb=False, wrap_u="clamp", wrap_v="clamp", nearest=not ramp_px)
    return replace(
        world,
        meshes=(replace(panel, vertices=vertices, uvs=uvs, material_ids=np.zeros_like(panel.material_ids)),),
        instances=(Instance(0, motion, "sheet"),),
        materials=(Material(color=(0.8, 0.8, 0.8), texture=0),),
        textures=(texture,),
        environment=(1.25, 1.25, 1.25),
    )


def measure_edges(
    speeds_px_s: Sequence[float],
    size: tuple[int, int],
    fps: float,
    time: str,
    report: Callable[[str], None],
) -> list[dict[str, Any]]:
    """Measure ``QUALITIES`` on edges of all kinds and of some speeds; ``report`` is told what is being measured.

    ``time`` says when brightness is found, as in a live run.

    Returns:
        One dict each: ``kind``, ``speed_px_s``, ``quality``, ``frames``, and what ``measure_edge`` returns.
    """
    check_time(time)
    rows = []
    for kind in KINDS:
        for speed in speeds_px_s:
            scene = edge_scene(kind, speed, *size, fps)
            for quality in QUALITIES:
                report(f"{kind} edge, {speed:g} px/s, {quality}")
                about = {"kind": kind, "speed_px_s": speed, "quality": quality, "frames": scene.frames}
                rows.append(about | measure_edge(scene, quality, fps, time))
    return rows


def measure_edge(scene: EdgeScene, quality: Quality, fps: float, time: str = "auto", seed: int = 0) -> dict[str, Any]:
    """Run a named quality on an edge and compare its events with the closed form.

    ``time`` says when brightness is found, as in a live run.

    Returns:
        ``events``, ``true_events``, ``matched`` (pairs at one pixel, of one polarity, at most a frame or a pixel of
        travel apart, whichever is longer), ``f1`` of these, ``error_px`` (speed times the median of their |Δt|; None
        without pairs), ``bias_px`` (speed times their mean Δt) and ``cpu_us_per_pixel_second``.
    """
    world, edge, camera = scene.world, scene.edge, scene.world.camera
    stages = plan_stages(LiveOptions("", fps=fps, quality=quality, time=time), world)
    if stages.options.time != "fixed":
        found, cpu_s = _run_between(scene, quality, fps, time, seed)
    else:
        point = named_points(seed)[quality]
        config = point.detector.config(world.sensor)
        options = point.options(fps, scene.frames, world.sensor)
        run = run_point(world, options, config, choose_device(), lambda: None)
        found, cpu_s = run.events, run.cpu_s
    truth = edge.events(camera.width, camera.height, (scene.frames - 1) / fps, world.sensor.threshold_on)
    window_us = round(1e6 * max(1 / fps, 1 / edge.speed_px_s))
    late = one_to_one(found, truth, Sampling(camera.width, camera.height, fps), window_us)
    px = edge.speed_px_s / 1e6
    return {
        "events": len(found),
        "true_events": len(truth),
        "matched": len(late),
        "f1": harmonic(len(late) / max(len(found), 1), len(late) / max(len(truth), 1)),
        "error_px": px * float(np.median(np.abs(late))) if len(late) else None,
        "bias_px": px * float(late.mean()) if len(late) else None,
        "cpu_us_per_pixel_second": 1e6 * cpu_s / (camera.width * camera.height * scene.frames / fps),
    }


def _run_between(scene: EdgeScene, quality: Quality, fps: float, time: str, seed: int) -> tuple[EventBatch, float]:
    """Return the events of a run that finds brightness between frames too, and its processor time [s]."""
    with Simulator(scene.world, quality=quality, fps=fps, seed=seed, time=time) as simulator:
        # The first steps build kernels.
        simulator.step(round(2e6 / fps))
        simulator.reset()
        begun = process_time()
        events = simulator.step(round(1e6 * (scene.frames - 1) / fps))
        return events, process_time() - begun
