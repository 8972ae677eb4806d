"""What clsim does on a GPU: rays a second by tree, and where the time of a frame goes.

python -m tools.speed.gpu_report [--device cuda:0] [--frames 20] [--rays] [SCENE@WIDTHxHEIGHT ...]

Rays are those of `clsim bench throughput`, for each way of building Warp's trees. Frames are rendered at ``balanced``;
times are medians: the whole frame by the wall clock, the kernels and copies of the device by its own events.
"""

from __future__ import annotations

import argparse
import collections
import statistics
import time
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import warp as wp

from clsim.bench.throughput.rays import aim, build_searches
from clsim.bench.throughput.render_worlds import bumpy_room, cornell
from clsim.frames import Frame, page_aligned
from clsim.live.options import LiveOptions
from clsim.live.stages import plan_stages
from clsim.render import PathTracer, RenderOptions, SceneData
from clsim.render.camera.camera import CameraData
from clsim.render.device.devices import start_warp
from clsim.scene import World, load_world

_SIZE = 1024
TREES = [("lbvh", 1), ("lbvh", 4), ("sah", 1), ("sah", 2), ("sah", 4), ("cubql", 0), ("cubql", 4)]
"""Constructor and triangles of a leaf; 0 lets the constructor choose."""


def rays(device: str) -> None:
    """Print rays a second, in millions, of three kinds."""
    worlds = {"cornell": cornell(_SIZE), "two-boxes": load_world("two-boxes"), "a million triangles": bumpy_room()}
    for name, world in worlds.items():
        print(f"\n{name}: millions of rays a second\n| tree | primary | bounce | shadow | built in s |")
        print("|---|---|---|---|---|")
        for constructor, leaf in TREES:
            build = wp.Mesh
            wp.Mesh = lambda points, indices, c=constructor, n=leaf, b=build: b(  # type: ignore[misc]
                points, indices, bvh_constructor=c, bvh_leaf_size=n
            )
            try:
                wp.synchronize()
                start = time.perf_counter()
                data = SceneData(world, device, tree="warp")
                wp.synchronize()
                seconds = time.perf_counter() - start
                found = " | ".join(f"{rate / 1e6:.0f}" for rate in ray_rates(world, data, device))
                print(f"| {constructor}, {leaf} | {found} | {seconds:.2f} |", flush=True)
            except Exception as error:
                print(f"| {constructor}, {leaf} | {type(error).__name__}: {error}")
            finally:
                wp.Mesh = build  # type: ignore[misc]


def ray_rates(world: World, data: SceneData, device: str) -> list[float]:
    """Return rays a second: primary rays, cosine-weighted bounces from where they hit, and shadow rays between hits."""
    features = RenderOptions(device=device).features_of(world)
    nearest, shadow, find = build_searches(features, "warp")
    n = _SIZE * _SIZE
    origins, directions, places, normals = (wp.zeros(n, dtype=wp.vec3, device=device) for _ in range(4))
    camera = CameraData(world.camera, features, data.origin_m, wp.get_device(device)).at(0.0)
    camera.right = camera.right * (world.camera.width / _SIZE)
    camera.down = camera.down * (world.camera.height / _SIZE)
    wp.launch(aim, dim=n, inputs=[camera, _SIZE], outputs=[origins, directions], device=device)
    geometry = data.scene.geometry
    wp.launch(find, dim=n, inputs=[geometry, origins, directions], outputs=[places, normals], device=device)
    place, normal = places.numpy(), normals.numpy()
    hit = np.flatnonzero(np.any(normal != 0, axis=1))
    rng = np.random.default_rng(0)
    way = rng.normal(size=(len(hit), 3))
    way = normal[hit] + way / np.linalg.norm(way, axis=1, keepdims=True)
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    start = place[hit] + normal[hit] * 1e-4
    other = start[rng.permutation(len(hit))]

    def vectors(values: Any) -> Any:
        return wp.array(np.ascontiguousarray(values, np.float32), dtype=wp.vec3, device=device)

    t, triangle = wp.zeros(n, dtype=float, device=device), wp.zeros(n, dtype=int, device=device)
    begun = vectors(start)
    kinds = [
        (nearest, origins, directions, [t, triangle]),
        (nearest, begun, vectors(way), [t, triangle]),
        (shadow, begun, vectors((other - start) * 0.999), [triangle]),
    ]
    rates = []
    for kernel, o, d, out in kinds:
        launch = wp.launch(kernel, dim=len(o), inputs=[geometry, o, d], outputs=out, device=device, record_cmd=True)
        rates.append(len(o) / median_s(launch.launch, device))
    return rates


def median_s(work: Callable[[], Any], device: str, rounds: int = 15) -> float:
    """Return the median of the seconds that some work takes on a device."""
    seconds = []
    for k in range(rounds + 3):
        wp.synchronize_device(device)
        start = time.perf_counter()
        work()
        wp.synchronize_device(device)
        if k >= 3:
            seconds.append(time.perf_counter() - start)
    return statistics.median(seconds)


def frames(name: str, width: int, height: int, count: int, device: str) -> None:
    """Print what a frame of a scene takes, and the kernels and copies in it."""
    options = LiveOptions(scene=name, resolution=(width, height), quality="balanced", render_device=device)
    stages = plan_stages(options)
    tracer = PathTracer(stages.world, stages.render)
    frame = Frame(page_aligned((len(tracer.names), height, width)), tracer.names)
    for index in range(5):
        tracer.fill(index, frame)
    walls, spent = [], collections.defaultdict(list)
    for index in range(5, 5 + count):
        start = time.perf_counter()
        tracer.fill(index, frame)
        wp.synchronize_device(device)
        walls.append(time.perf_counter() - start)
    wp.timing_begin(wp.TIMING_ALL)
    for index in range(5 + count, 5 + 2 * count):
        tracer.fill(index, frame)
    for part in wp.timing_end():
        spent[part.name].append(part.elapsed)
    print(f"\n{name} {width}x{height}: {1e3 * statistics.median(walls):.2f} ms a frame")
    for part, each in sorted(spent.items(), key=lambda item: -sum(item[1])):
        if sum(each) / count > 0.02:
            print(f"  {sum(each) / count:8.3f} ms  {len(each) / count:6.1f} times  {part}")
    tracer.close()


def main(arguments: Iterable[str] | None = None) -> None:
    """Measure what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*")
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--frames", type=int, default=20)
    parser.add_argument("--rays", action="store_true")
    given = parser.parse_args(arguments)
    start_warp()
    if given.rays:
        rays(given.device)
    for scene in given.scenes:
        name, _, size = scene.partition("@")
        width, height = map(int, size.split("x"))
        frames(name, width, height, given.frames, given.device)


if __name__ == "__main__":
    main()
