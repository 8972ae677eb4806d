"""The path tracer: a World in, Frames out."""

from __future__ import annotations

import os
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Literal

import warp as wp

from clsim.errors import Error, InputError, require_choice
from clsim.frames import Frame, InterestBoard, frame_time_us, rendered_planes
from clsim.render.camera import CameraData
from clsim.render.devices import check_device, fastest_tree
from clsim.render.effort import Effort, Steerer
from clsim.render.features import Features, Strategy, features_of
from clsim.render.geometry import Tree
from clsim.render.integrator import Settings, build_kernel
from clsim.render.sampling import MAX_BOUNCES
from clsim.render.steered import Steering
from clsim.render.upload import SceneData
from clsim.scene import World
from clsim.scene.validate import validate

_TILE_PATHS = 4096
"""Paths a launch on a CPU traces: some 10 ms, so that an interrupt is quick and threads end together."""
_MAX_TARGETS = 16
"""Frames whose memory is remembered: more than a ring has slots."""
SOBOL_BATCHES = 4
"""Independently scrambled batches of Sobol points; more make variances surer and pictures noisier."""
LARGEST_SPP, LARGEST_FIRST_HIT_RAYS = 1 << 20, 4096
"""Nobody means more: a digit too many is better told than waited for."""
_MASK64 = (1 << 64) - 1


class RenderCancelled(Error):  # noqa: N818 - asked for, not an error
    """``PathTracer.cancel`` was called; the frame is incomplete."""


@dataclass(frozen=True)
class RenderOptions:
    """How to render a world."""

    spp: int = 8
    """Paths per pixel and frame."""
    fps: float | None = None
    """Frames per simulated second; None takes the world's."""
    frames: int | None = None
    """Number of frames; None plays the world's motion once, both ends included."""
    seed: int = 0
    """Seed of all random numbers, 0 to 2⁶⁴ − 1."""
    noise: Literal["common", "independent"] = "common"
    """Whether every frame uses the same random numbers, so that a still pixel stays exactly the same, or its own."""
    max_depth: int = 8
    """Longest path in edges: 1 sees emitters only, 2 adds direct light, 3 one bounce of indirect light."""
    roulette_start: int = 5
    """Number of edges after which Russian roulette may end a path."""
    threads: int | None = None
    """Threads on a CPU; None takes one a core. Pictures do not depend on it."""
    tile_pixels: int | None = None
    """Pixels in a launch; None chooses. Pictures do not depend on it."""
    device: str = "cpu"
    """Render device, "cpu" or "cuda:0" …"""
    variances: bool = False
    """Whether frames have the planes of variances."""
    strategy: Strategy = "mis"
    """How light is found; other than "mis" only to check it."""
    sampler: Literal["pcg", "sobol"] = "pcg"
    """Whether samples are independent ("pcg") or spread evenly by Owen-scrambled Sobol points, in four batches.

    With "sobol", sample i belongs to batch i mod 4; batches are independent, and variances are estimated from their
    means: that is honest, but noisier, and up to a fifth too large where the number of samples is not a multiple of 4.
    A power of 2 from 4 is spread best.
    """
    follow_specular: bool = True
    """Whether the planes of albedo, normal and depth show what mirrors and clear glass show instead of themselves.

    Depth is then the length of the way, albedo is multiplied by what the chain of mirrors lets through, and normals
    are those of the surface found, not mirrored. Where glass both reflects and refracts, each sample takes one way, so
    that the planes hold the mean of two surfaces and a variance. A way that ends nowhere shows the last mirror.
    """
    first_hit_rays: int = 0
    """Rays a pixel that look for the first hit alone, so many where it shows more than one thing; 0 for none.

    They give the features and the light seen directly, and paths only the irradiance, so that textures and edges are
    clean after few paths; frames have an emission plane then.
    """
    probe_spp: int | None = None
    """Paths where no event is near, doubled elsewhere; None traces ``spp``. Needs first-hit rays and common noise."""
    probe_every: int = 1
    """Frames from one probe of a pixel to the next where no event is near; in between, the last irradiance is taken.

    Needs first-hit rays and common noise where it is more than 1.
    """
    tree: Tree | None = None
    """How rays find triangles; None takes the fastest of the device, others are there to compare."""

    def __post_init__(self) -> None:
        """Refuse values that cannot work."""
        require_choice("noise", self.noise, ("common", "independent"))
        require_choice("sampler", self.sampler, ("pcg", "sobol"))
        require_choice("tree", self.tree, (None, "bvh8", "warp"))
        for option, value in (
            ("spp", self.spp),
            ("frames", self.frames),
            ("max_depth", self.max_depth),
            ("threads", self.threads),
            ("tile_pixels", self.tile_pixels),
            ("probe_spp", self.probe_spp),
            ("probe_every", self.probe_every),
        ):
            if value is not None and value < 1:
                raise InputError(f"`{option}` must be at least 1, got {value}")
        for option, count, limit in (
            ("spp", self.spp, LARGEST_SPP),
            ("first_hit_rays", self.first_hit_rays, LARGEST_FIRST_HIT_RAYS),
            ("max_depth", self.max_depth, MAX_BOUNCES),
        ):
            if count > limit:
                raise InputError(f"`{option}` must be at most {limit}, got {count}")
        if self.fps is not None and not 0 < self.fps < float("inf"):
            raise InputError(f"`fps` must be a positive number, got {self.fps}")
        if not 0 <= self.seed <= _MASK64:
            raise InputError(f"`seed` must be from 0 to 2^64 - 1, got {self.seed}")
        if self.first_hit_rays < 0:
            raise InputError(f"`first_hit_rays` must be at least 0, got {self.first_hit_rays}")
        if self.first_hit_rays and self.variances:
            raise InputError("first-hit rays give no variances; expected `first_hit_rays` 0 where variances are wanted")
        for option, steers in (("probe_spp", self.probe_spp is not None), ("probe_every", self.probe_every > 1)):
            if steers and not self.first_hit_rays:
                raise InputError(f"`{option}` needs `first_hit_rays` of at least 1, got 0")
            if steers and self.noise != "common":
                raise InputError(f"`{option}` needs `noise` common, got {self.noise}")
        if self.probe_spp is not None and self.probe_spp > self.spp:
            raise InputError(f"`probe_spp` must be at most `spp`, which is {self.spp}, got {self.probe_spp}")

    def features(self, world: World) -> Features:
        """Return what the kernel for that world has."""
        sobol, first_hits = self.sampler == "sobol", self.first_hit_rays > 0
        return features_of(world, self.variances, self.strategy, self.follow_specular, sobol, first_hits)


def describe_build(world: World, options: RenderOptions) -> dict[str, Any]:
    """Return what is "built in" to this world's kernel and what is "left out".

    With it the "device" and the "tree" that rays search there.
    """
    facts = options.features(world).describe()
    place = {"device": options.device, "tree": options.tree or fastest_tree(options.device)}
    return place | facts


class PathTracer:
    """Renders a world; a ``clsim.frames.FrameSource``.

    Sample i of a pixel is the same path whatever the number of samples, threads, tiles and planes, and with common
    noise whatever the frame. Features are of the first hit, be it a lamp: an emitting triangle has its
    material's albedo, a sphere light has albedo 0.
    """

    def __init__(self, world: World, options: RenderOptions, board: InterestBoard | None = None) -> None:
        """Copy the world to the device and build its kernel.

        Args:
            world: what is rendered.
            options: how it is rendered.
            board: where interest maps are found, one frame's for each that is filled; without, no event is ever near.

        Raises:
            InputError: the world or an option cannot be used.
        """
        validate(world, world.name)
        camera = world.camera
        check_device(options.device)
        self.width = camera.width
        self.height = camera.height
        planes = rendered_planes(first_hit_rays=options.first_hit_rays > 0, variances=options.variances)
        self.names: tuple[str, ...] = planes.names
        self.fps = options.fps or world.fps
        self.frame_count: int | None = options.frames or max(1, round(world.duration_s * self.fps)) + 1
        self._options = options
        self._device = wp.get_device(options.device)
        features = options.features(world)
        tree = options.tree or fastest_tree(options.device)
        if tree == "bvh8" and not self._device.is_cpu:
            raise InputError(f'tree is "bvh8", which works on a CPU only, but the render device is {options.device}')
        self._kernel = build_kernel(features, tree)
        self._camera = CameraData(camera, features, self._device)
        self._data = SceneData(world, features, tree, self._device)
        self._settings: Any = Settings()
        self._settings.samples = options.spp
        self._settings.batches = SOBOL_BATCHES
        self._settings.max_depth = options.max_depth
        self._settings.roulette_start = options.roulette_start
        self._settings.width = camera.width
        self._steerer: Steerer | None = None
        if options.first_hit_rays:
            probe_spp = options.probe_spp or options.spp
            effort = Effort(options.spp, probe_spp, options.first_hit_rays, options.probe_every)
            self._steerer = Steerer(camera.width, camera.height, effort, board, self._device)
        self._paths = 0
        self._cancelled = threading.Event()
        self._targets: dict[int, tuple[Any, Any]] = {}

        pixels = camera.width * camera.height
        if self._device.is_cpu:
            threads = options.threads or len(os.sched_getaffinity(0))
            self._tile = options.tile_pixels or max(1, _TILE_PATHS // (options.probe_spp or options.spp))
        else:
            threads = 1
            self._tile = options.tile_pixels or pixels
        self._tile = min(self._tile, pixels)
        self._launches = [self._record() for _ in range(min(threads, -(-pixels // self._tile)))]
        # The calling thread renders too.
        self._pool = ThreadPoolExecutor(len(self._launches) - 1, "clsim-tile") if len(self._launches) > 1 else None

    def fill(self, index: int, out: Frame) -> None:
        """Render frame ``index`` (from 0; beyond the motion's end it goes on as the motion does) into ``out``.

        Raises:
            RenderCancelled: ``cancel`` was called, before or meanwhile.
        """
        if out.names != self.names or (out.height, out.width) != (self.height, self.width):
            raise ValueError(f"expected a frame {self.width}x{self.height} with the planes {', '.join(self.names)}")
        if self._cancelled.is_set():
            raise RenderCancelled
        time_us = frame_time_us(index, self.fps)
        time_s = time_us * 1e-6
        self._data.update(time_s)
        camera = self._camera.at(time_s)
        self._settings.stream = stream_state(
            self._options.seed, index if self._options.noise == "independent" else None
        )
        planes, bits = self._target(out)
        changed: dict[int, Any] = {1: camera, 2: self._settings}
        if self._steerer is None:
            changed |= {4: planes, 5: bits}
        else:
            steering, self._settings.samples = self._steerer.prepare(index)
            changed |= {4: steering, 9: planes}
        for launch in self._launches:
            for place, value in changed.items():
                launch.set_param_at_index(place, value)
        self._render_tiles()
        if self._steerer is None:
            self._paths += self.width * self.height * self._options.spp
        else:
            self._steerer.count()
        if not self._device.is_cpu:
            wp.copy(self._host(out), planes)
            wp.synchronize_device(self._device)
        out.time_us, out.index = time_us, index

    @property
    def effort(self) -> Effort:
        """What is spent on a pixel; set it, from any thread, for the next frame on. First-hit rays cannot be left out.

        With common noise, a change of paths fires no event: the log brightness of a still picture stays within 1e-4.
        Other numbers of first-hit rays do change a still picture, where it is textured.
        """
        if self._steerer is None:
            raise ValueError("only a renderer with first-hit rays has an effort")
        return self._steerer.effort

    @effort.setter
    def effort(self, effort: Effort) -> None:
        if self._steerer is None:
            raise ValueError("only a renderer with first-hit rays can change its effort")
        self._steerer.effort = effort

    @property
    def paths(self) -> int:
        """Paths traced so far."""
        return self._paths if self._steerer is None else self._steerer.paths

    @property
    def first_hit_rays(self) -> int:
        """First-hit rays traced so far."""
        return 0 if self._steerer is None else self._steerer.first_hit_rays

    def cancel(self) -> None:
        """Make a running ``fill``, and every later one, raise RenderCancelled within a tile; safe from any thread."""
        self._cancelled.set()

    def close(self) -> None:
        """End the threads and let go of all memory; safe to call twice."""
        self.cancel()
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None
        self._launches.clear()
        self._targets.clear()

    def _record(self) -> Any:
        """Record a launch, one for each thread since its parameters change."""
        planes = wp.zeros((len(self.names), self._tile), dtype=wp.float32, device=self._device)
        bits: Any = wp.array(ptr=planes.ptr, shape=planes.shape, dtype=wp.uint32, device=self._device)
        camera = self._camera.at(0.0)
        inputs, outputs = [self._data.scene, camera, self._settings, 0], [planes, bits]
        if self._steerer is not None:
            inputs += [Steering(), *self._steerer.kept]
            outputs = [planes, self._steerer.spent]
        return wp.launch(
            self._kernel,
            dim=self._tile,
            inputs=inputs,
            outputs=outputs,
            device=self._device,
            record_cmd=True,
        )

    def _render_tiles(self) -> None:
        pixels = self.width * self.height
        tiles = iter(range(0, pixels, self._tile))
        # next() of a range iterator is one step of the interpreter, so that threads may share it.
        workers = [self._pool.submit(self._drain, launch, tiles) for launch in self._launches[1:]] if self._pool else []
        try:
            self._drain(self._launches[0], tiles)
        except BaseException:
            self._cancelled.set()
            raise
        finally:
            for worker in workers:
                worker.result()
        if self._cancelled.is_set():
            raise RenderCancelled

    def _drain(self, launch: Any, tiles: Any) -> None:
        for first in tiles:
            if self._cancelled.is_set():
                return
            launch.set_dim(min(self._tile, self.width * self.height - first))
            launch.set_param_at_index(3, first)
            launch.launch()

    def _target(self, out: Frame) -> tuple[Any, Any]:
        """Return the array that the kernel writes, and the same as bits: the frame's own memory on a CPU."""
        shape = (len(self.names), self.width * self.height)
        address = out.planes.ctypes.data if self._device.is_cpu else 0
        if address not in self._targets:
            if len(self._targets) == _MAX_TARGETS:
                self._targets.clear()
            on_host = self._device.is_cpu
            planes = self._host(out) if on_host else wp.empty(shape, dtype=wp.float32, device=self._device)
            bits: Any = wp.array(ptr=planes.ptr, shape=shape, dtype=wp.uint32, device=self._device)
            self._targets[address] = (planes, bits)
        return self._targets[address]

    def _host(self, out: Frame) -> Any:
        shape = (len(self.names), self.width * self.height)
        return wp.array(ptr=out.planes.ctypes.data, shape=shape, dtype=wp.float32, device="cpu")


def stream_state(seed: int, frame: int | None) -> int:
    """Return the hash of a seed, and of a frame's index where each has its own noise, as the kernel goes on with it."""
    state = _mix64(seed + 0x9E3779B97F4A7C15)
    return state if frame is None else _mix64(state + (frame + 1) * 0xD1342543DE82EF95)


def _mix64(x: int) -> int:
    """``sampling.mix64`` on the host."""
    x &= _MASK64
    x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9 & _MASK64
    x = (x ^ (x >> 27)) * 0x94D049BB133111EB & _MASK64
    return x ^ (x >> 31)
