"""How fast the renderer is on CPUs: rays of three kinds, whole paths, both trees."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import warp as wp

from clsim.bench.throughput.rays import aim, build_searches
from clsim.bench.throughput.render_worlds import bumpy_room, cornell
from clsim.frames import Frame, page_aligned
from clsim.render import PathTracer, RenderOptions, SceneData
from clsim.render.accel.bvh16 import Bvh16
from clsim.render.accel.geometry import Tree
from clsim.render.camera.camera import CameraData
from clsim.render.device.devices import start_warp, usable_cores
from clsim.scene import World

MAX_DEPTH = 8
_RAYS = 1 << 17
_TREES: tuple[Tree, ...] = ("bvh16", "warp")


def render_throughput(*, size: int = 256, spp: int = 16, rounds: int = 3, triangles: int = 1_000_000) -> dict[str, Any]:
    """Measure Cornell and a room of about ``triangles`` triangles, paths of 8 edges without roulette.

    What is compared takes turns within a round, and each figure is the median over ``rounds``; processor seconds are
    those of all threads, so that other programs count little.

    Returns:
        For each world, "cornell" and "bumpy-room": ``triangles``, ``build_s``, ``bytes_per_triangle``,
        ``rays_per_cpu_second`` (by tree: primary, bounce, shadow), ``paths_per_second``, ``paths_per_cpu_second`` and
        ``mean_radiance`` (by tree).
    """
    start_warp()
    worlds = {"cornell": cornell(size), "bumpy-room": bumpy_room(triangles, size)}
    return {name: measure_world(world, spp, rounds, {}) for name, world in worlds.items()}


def measure_world(world: World, spp: int, rounds: int, others: Mapping[str, Callable[[], float]]) -> dict[str, Any]:
    """Measure one world; see ``render_throughput``.

    ``others`` are renderers by name: each call traces ``spp`` paths a pixel and returns the mean radiance. They take
    turns with the trees, and stand beside them in the results.
    """
    result: dict[str, Any] = _tree_cost(world) | {"rays_per_cpu_second": _ray_rates(world, rounds)}
    renders: dict[str, Callable[[], float]] = {tree: _our_render(world, spp, tree) for tree in _TREES} | dict(others)
    paths = world.camera.width * world.camera.height * spp
    result["mean_radiance"] = {name: render() for name, render in renders.items()}
    wall, cpu = take_turns({name: [render] for name, render in renders.items()}, rounds)
    result["paths_per_second"] = {name: paths / seconds for name, seconds in wall.items()}
    result["paths_per_cpu_second"] = {name: paths / seconds for name, seconds in cpu.items()}
    return result


def take_turns(works: dict[str, list[Callable[[], Any]]], rounds: int) -> tuple[dict[str, float], dict[str, float]]:
    """Return the median wall-clock and processor seconds of each work."""
    wall: dict[str, list[float]] = {name: [] for name in works}
    cpu: dict[str, list[float]] = {name: [] for name in works}
    for _ in range(rounds):
        for name, calls in works.items():
            start = time.perf_counter(), time.process_time()
            for call in calls:
                call()
            wall[name].append(time.perf_counter() - start[0])
            cpu[name].append(time.process_time() - start[1])
    return _medians(wall), _medians(cpu)


def _medians(seconds: dict[str, list[float]]) -> dict[str, float]:
    return {name: statistics.median(each) for name, each in seconds.items()}


def _tree_cost(world: World) -> dict[str, Any]:
    data = SceneData(world, tree="bvh16")
    geometry = data.scene.geometry
    seconds = []
    for _ in range(3):
        start = time.process_time()
        tree = Bvh16(geometry.vertices, geometry.indices)
        seconds.append(time.process_time() - start)
    triangles = len(geometry.indices) // 3
    return {"triangles": triangles, "build_s": min(seconds), "bytes_per_triangle": tree.nbytes / triangles}


def _ray_rates(world: World, rounds: int) -> dict[str, dict[str, float]]:
    """Measure rays on one thread: from the camera, from its hits in cosine-weighted directions, and to a lamp."""
    device = wp.get_device("cpu")
    features = RenderOptions().features_of(world)
    searches = {tree: build_searches(features, tree) for tree in _TREES}
    scenes = {tree: SceneData(world, tree=tree) for tree in _TREES}
    width, height = world.camera.width, world.camera.height
    n = width * height
    origins, directions, places, normals = (wp.zeros(n, dtype=wp.vec3, device=device) for _ in range(4))
    camera = CameraData(world.camera, features, scenes["bvh16"].origin_m, device).at(0.0)
    wp.launch(aim, dim=n, inputs=[camera, width], outputs=[origins, directions], device=device)
    nearest, shadow, find = searches["bvh16"]
    geometry = scenes["bvh16"].scene.geometry
    wp.launch(find, dim=n, inputs=[geometry, origins, directions], outputs=[places, normals], device=device)
    place, normal = (np.asarray(array) for array in (places, normals))
    hit = np.flatnonzero(np.any(normal != 0, axis=1))
    rng = np.random.default_rng(0)
    hit = hit[np.sort(rng.integers(len(hit), size=_RAYS))]
    place, normal = place[hit] + normal[hit] * 1e-4, normal[hit]
    scattered = rng.normal(size=(_RAYS, 3))
    scattered = normal + scattered / np.linalg.norm(scattered, axis=1, keepdims=True)
    corners = _lamp_corners(world)
    weights = rng.dirichlet((1, 1, 1), _RAYS)
    lamps = np.einsum("nk,nkj->nj", weights, corners[rng.integers(len(corners), size=_RAYS)])

    def vectors(values: Any) -> Any:
        return wp.array(np.ascontiguousarray(values, np.float32), dtype=wp.vec3, device=device)

    start = vectors(place)
    rays = {
        "primary": (origins, directions),
        "bounce": (start, vectors(scattered / np.linalg.norm(scattered, axis=1, keepdims=True))),
        "shadow": (start, vectors((lamps - place) * 0.999)),
    }
    works: dict[str, list[Callable[[], Any]]] = {}
    counts: dict[str, int] = {}
    for tree in _TREES:
        nearest, shadow, _ = searches[tree]
        for kind, (o, d) in rays.items():
            count = o.shape[0]
            out = [wp.zeros(count, dtype=int, device=device)]
            if kind != "shadow":
                out = [wp.zeros(count, dtype=float, device=device), *out]
            launch = wp.launch(
                shadow if kind == "shadow" else nearest,
                dim=count,
                inputs=[scenes[tree].scene.geometry, o, d],
                outputs=out,
                device=device,
                record_cmd=True,
            )
            launch.launch()
            works[f"{tree} {kind}"] = [launch.launch] * 4
            counts[f"{tree} {kind}"] = 4 * count
    _, cpu = take_turns(works, rounds)
    return {tree: {kind: counts[f"{tree} {kind}"] / cpu[f"{tree} {kind}"] for kind in rays} for tree in _TREES}


def _lamp_corners(world: World) -> Any:
    """Return the corners ``[n, 3, 3]`` of all emitting triangles."""
    corners = []
    for instance in world.instances:
        mesh, pose = world.meshes[instance.mesh], instance.motion.pose(0.0)
        emits = np.array([max(material.emission) > 0 for material in world.materials])[mesh.material_ids]
        corners.append((mesh.vertices @ pose[:3, :3].T + pose[:3, 3])[mesh.triangles[emits]])
    return np.concatenate(corners)


def _our_render(world: World, spp: int, tree: Tree) -> Callable[[], float]:
    threads = usable_cores()
    # With common noise a picture in which nothing has moved would not be rendered again.
    options = RenderOptions(
        spp=spp, max_depth=MAX_DEPTH, roulette_start=1000, threads=threads, tree=tree, noise="independent"
    )
    tracer = PathTracer(world, options)
    frame = Frame(page_aligned((len(tracer.names), tracer.height, tracer.width)), tracer.names)

    def render() -> float:
        tracer.fill(0, frame)
        return float(frame.planes[:3].mean())

    return render
