"""A camera's view of a scene: a source of frames."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import numpy.typing as npt
import warp as wp

from clsim.errors import Error, InputError
from clsim.frames import Frame, InterestBoard, frame_time_us, rendered_planes
from clsim.render.camera.camera import CameraData
from clsim.render.camera.film import Sample
from clsim.render.camera.pixel_width import pixel_of, widest_pixel
from clsim.render.device.launch import Threads, Tiles, record, tile_size
from clsim.render.kernel_input import settings_of
from clsim.render.motion.standstill import Standstill
from clsim.render.options import RenderOptions
from clsim.render.paths.integrator import build_kernel
from clsim.render.primary.effort import ENOUGH_FOR_EDGES, Effort, PrimarySetup, Steerer
from clsim.render.sampling.sampling import stream_state
from clsim.render.scene_data import SceneData
from clsim.scene import Camera
from clsim.scene.light.spectral import seen_by_pixels

if TYPE_CHECKING:
    from clsim.render.cache.light_cache_host import LightCacheHost
    from clsim.render.cache.path_store import PathStore
    from clsim.render.truth.truth_pass import TruthPass

_MAX_TARGETS = 16
"""Frames whose memory is remembered: more than a ring has slots."""


def _as_bits(planes: Any) -> Any:
    """Return the same memory as unsigned integers."""
    return wp.array(ptr=planes.ptr, shape=planes.shape, dtype=wp.uint32, device=planes.device)


class RenderCancelled(Error):  # noqa: N818 - asked for, not an error
    """``View.cancel`` was called; the frame is incomplete."""


class View:
    """A camera's view of a scene: its rays, launches and frame memory; a ``clsim.frames.FrameSource``.

    Sample i of a pixel is the same path whatever the number of samples, threads, tiles and planes, and with common
    noise whatever the frame. Features are of the first hit, be it a lamp: an emitting triangle has its
    material's albedo, a sphere light has albedo 0.

    Attributes:
        width, height: of its frames [pixels].
        names: their planes.
        fps: frames per simulated second.
        frame_count: frames until the motion ends, or as many as were asked for.
        noise_offset: added to a frame's index where each has its own noise, so that a loop need not repeat it.
    """

    def __init__(
        self,
        data: SceneData,
        options: RenderOptions,
        board: InterestBoard | None = None,
        camera: Camera | None = None,
    ) -> None:
        """Build the kernel for what the scene and the camera have.

        Args:
            data: what is rendered; other views may share it, as long as one renders at a time.
            options: how it is rendered; device and tree are those of ``data``.
            board: where interest maps are found, one frame's for each that is filled; without, no event is ever near.
            camera: the camera; None takes the world's.

        Raises:
            InputError: the exposure is longer than the interval of ``data``.
        """
        camera = camera or data.world.camera
        if camera.shutter_s > data.interval_s:
            raise InputError(
                f"the camera exposes for {camera.shutter_s:g} s, expected at most the interval of the scene's data, "
                f"{data.interval_s:g} s"
            )
        self.width, self.height = camera.width, camera.height
        self._pixel = pixel_of(camera)
        self._shutter_s, self._light = camera.shutter_s, np.zeros(0)
        planes = rendered_planes(
            first_hit_rays=options.first_hit_rays > 0, variances=options.variances, truth=options.truth
        )
        self.names: tuple[str, ...] = planes.names
        self.fps = options.fps or data.world.fps
        self.frame_count: int | None = options.frames or max(1, round(data.world.duration_s * self.fps)) + 1
        self.noise_offset = 0
        self._data = data
        self._options = options
        self._device = data.device
        features = options.features(data.features, camera)
        self._kernel = build_kernel(features, data.tree)
        clear_m = data.clear_m if options.first_hit_rays else None
        self._camera = CameraData(camera, features, data.origin_m, self._device, clear_m)
        self._motion, self._sky_differs = camera.motion, features.environment_map
        self._settings: Any = settings_of(options, camera, data.world.sensor)
        if features.motion_blur:
            share = camera.shutter_s / data.interval_s
            self._settings.opens, self._settings.lasts = 0.5 - 0.5 * share, share
        self._threads = Threads(options.threads, self._device)
        self._store: PathStore | None = None
        self._steerer: Steerer | LightCacheHost | None = None
        self._widest_rad = widest_pixel(camera) if features.sharp and self._pixel[0] > 0.0 else 0.0
        if options.first_hit_rays:
            data.add_texture_levels()
            probe_spp = options.probe_spp or options.spp
            effort = Effort(options.spp, probe_spp, options.first_hit_rays, options.probe_every)
            self._corners: Any = wp.zeros((self.width + 1) * (self.height + 1), dtype=Sample, device=self._device)
            size = camera.width, camera.height
            self._sharp = features.sharp
            primary_setup = PrimarySetup(self._pixel, features.sharp, features.lamp_light)
            if options.light_cache:
                from clsim.render.cache.light_cache_host import LightCacheHost, next_event
                from clsim.render.cache.stored_hits_host import StoredHitsHost

                event = next_event(options.fires_at, data.world.sensor)
                self._store = store = self._path_store(options, camera) if features.anchored else None
                hits = StoredHitsHost(data, math.prod(size)) if features.stores_hits else None
                error, twice = options.first_frame_error, options.duplicate_every
                self._steerer = LightCacheHost(
                    *size,
                    effort,
                    primary_setup,
                    options.light_hz,
                    event,
                    error,
                    twice,
                    store,
                    hits,
                    self._threads,
                    self._device,
                )
            else:
                at_frames = options.light_hz is None
                self._steerer = Steerer(*size, effort, primary_setup, board, self._device, refines=at_frames)
        # With other noise, or steered by what was found in frames before, each frame is another one.
        repeats = options.noise == "common" and (self._steerer is None or options.light_cache)
        self._standstill = Standstill(data.world, camera) if repeats else None
        # Duplicate pixels are written at the same place of planes of their own.
        numbers = self._pixels_to_duplicate() if self._steerer is None else np.zeros(0, np.int32)
        of_square = np.asarray(seen_by_pixels(data.world.sensor), np.float32)
        self._duplicate_pixels = numbers
        self._duplicate_weights = of_square[2 * (numbers // self.width % 2) + numbers % self.width % 2]
        pixels = camera.width * camera.height if len(self._duplicate_pixels) else 0
        self._duplicate_planes: Any = wp.zeros((len(self.names), pixels), dtype=wp.float32, device=self._device)
        self._duplicate_pixels_on_device: Any = wp.array(self._duplicate_pixels, dtype=int, device=self._device)
        self._all: Any = wp.zeros(0, dtype=int, device=self._device)
        self._truth: TruthPass | None = None
        if planes.truth:
            from clsim.render.truth.truth_pass import TruthPass

            self._truth = TruthPass(data, camera, planes)
        self._paths = 0
        self._targets: dict[int, tuple[Any, Any]] = {}
        tile = options.tile_pixels or tile_size(options.probe_spp or options.spp, self._device)
        pixels, count = camera.width * camera.height, "pixels" if self._steerer is not None else None
        self._tiles = Tiles(self._threads, self._record, "first_pixel", pixels, tile, count)

    def fill(self, index: int, out: Frame) -> None:
        """Render frame ``index`` (from 0; beyond the motion's end it goes on as the motion does) into ``out``.

        Raises:
            RenderCancelled: ``cancel`` was called, before or meanwhile.
        """
        with self._data.lock:
            self.fill_at(index, frame_time_us(index, self.fps), out)
            if self._truth is not None:
                every, next_us = self._options.truth_every, frame_time_us(index + 1, self.fps)
                if index % every == 0:
                    before_us = frame_time_us(index - every, self.fps) if index >= every else None
                    self.fill_truth(out, before_us, frame_time_us(index + every, self.fps), next_us)
                elif self._truth.labels:
                    self._truth.fill(out.planes, out.time_us, {"Label.flow": next_us})

    def fill_at(self, index: int, time_us: int, out: Frame) -> None:
        """Render the world at a time [µs] of the caller's choice, as frame ``index``, into ``out``.

        Raises:
            RenderCancelled: ``cancel`` was called, before or meanwhile.
        """
        if out.names != self.names or (out.height, out.width) != (self.height, self.width):
            raise ValueError(f"expected a frame {self.width}x{self.height} with the planes {', '.join(self.names)}")
        if self._threads.cancelled:
            raise RenderCancelled
        time_s = time_us * 1e-6
        self._data.move(time_s)
        out.time_us, out.index = time_us, index
        if self._standstill is None:
            self._render_at(index, time_us, out)
        elif not self._standstill.repeat(time_s, self._steerer and self._steerer.effort, out.planes):
            self._render_at(index, time_us, out)
            self._standstill.remember(out.planes)
        elif self._steerer is not None:
            cast("LightCacheHost", self._steerer).rest(time_us)

    def _render_at(self, index: int, time_us: int, out: Frame) -> None:
        time_s = time_us * 1e-6
        noise_of = index + self.noise_offset if self._options.noise == "independent" else None
        self._settings.stream = stream_state(self._options.seed, noise_of)
        pose = self._motion.pose(time_s)
        if not self._sky_differs:
            self._settings.reach_m = self._data.farthest_m(pose[:3, 3])
            if self._options.first_hit_rays and self._pixel[0] > 0.0:
                self._settings.least_sphere_rad = self._data.least_sphere_rad(pose[:3, 3], time_s)
        if self._widest_rad > 0.0:
            self._settings.specks = self._data.specks(pose[None, :3, 3], self._widest_rad)
        planes, bits = self._target(out)
        changed = {"camera": self._camera.at(time_s), "settings": self._settings, "out_planes": planes}
        changed |= self._shine(time_s)
        if self._steerer is None:
            self._render(changed | {"pixels": self._all, "out_bits": bits}, self.width * self.height)
            self._paths += self.width * self.height * self._options.spp
            if len(self._duplicate_pixels):
                # Independent of the frame: the seed's complement is nobody's.
                self._settings.stream = stream_state(~self._options.seed, noise_of)
                duplicate_every = {"out_planes": self._duplicate_planes, "out_bits": _as_bits(self._duplicate_planes)}
                self._render(
                    changed | duplicate_every | {"pixels": self._duplicate_pixels_on_device},
                    len(self._duplicate_pixels),
                )
        else:
            unfinished = True
            while unfinished:
                steering, self._settings.samples = self._steerer.prepare(index, time_us, pose)
                changed |= steering
                if steering["steering"].primary_rays.steps:
                    self._render(changed | {"corner_pass": True}, (self.width + 1) * (self.height + 1))
                self._render(changed | {"corner_pass": False}, self.width * self.height)
                unfinished = self._steerer.finish()
            if self._options.duplicate_every:
                count = -(-self.width * self.height // self._options.duplicate_every)
                self._render(changed | {"corner_pass": False, "duplicate_every": self._options.duplicate_every}, count)
        if not self._device.is_cpu:
            wp.copy(self._host(out), planes)
            wp.synchronize_device(self._device)

    def fill_truth(self, out: Frame, before_us: int | None, after_us: int, next_us: int) -> None:
        """Fill the planes of truth, if there are any, of a frame that was rendered.

        Backward and forward flow lead to the times ``before_us`` and ``after_us``, labels are for events until
        ``next_us`` [µs]. The scene is left at one of these times.
        """
        if self._truth is not None:
            ends_us = {"Flow.backward": before_us, "Flow.forward": after_us, "Label.flow": next_us}
            self._truth.fill(out.planes, out.time_us, ends_us)

    @property
    def effort(self) -> Effort:
        """What is spent on a pixel; set it, from any thread, for the next frame on. Primary rays cannot be left out.

        With common noise, a change of paths fires no event: the log brightness of a still picture stays within 1e-4.
        Other numbers of primary rays do change a still picture, where it is textured.
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
        """Primary rays traced so far."""
        return 0 if self._steerer is None else self._steerer.first_hit_rays

    @property
    def light_s(self) -> float:
        """Time [s] that updating the radiance cache has taken so far; 0 without one."""
        return 0.0 if self._steerer is None else self._steerer.light_s

    @property
    def light_cache_host(self) -> LightCacheHost:
        """The radiance cache that shades its frames, where there is one."""
        assert self._options.light_cache
        return cast("LightCacheHost", self._steerer)

    @property
    def corners(self) -> Any:
        """What rays at the corners of pixels saw in the last frame, on the device; None where there are none."""
        looked_at = self._sharp and self.effort.first_hit_rays >= ENOUGH_FOR_EDGES
        return self._corners if looked_at else None

    def sampled_twice(self, frame: Frame) -> npt.NDArray[np.float32]:
        """Return two estimates of the duplicate pixels: that of the last frame, and the second one.

        It is the luminance of pixels, ``[2, n]``; of patches all planes, ``[2, C, rows, columns]``. With cached light,
        one is raised and one lowered by the error of that light.
        """
        if self._steerer is not None:
            return cast("LightCacheHost", self._steerer).sampled_twice
        planes = frame.planes.reshape(len(self.names), -1), self._duplicate_planes.numpy()
        patches = self._options.duplicate_in
        if patches is not None:
            return np.stack([each[:, self._duplicate_pixels] for each in planes]).reshape(2, -1, *patches.shape)
        weights, pixels = self._duplicate_weights, self._duplicate_pixels
        return np.stack([np.einsum("nc,cn->n", weights, each[:3, pixels]) for each in planes])

    def forget_light(self) -> None:
        """Forget, or trace again, what is cached of the light, for the next frame: lights have changed."""
        if self._standstill is not None:
            self._standstill.forget()
        if self._steerer is not None:
            self._steerer.forget()

    def cancel(self) -> None:
        """Make a running ``fill``, and every later one, raise RenderCancelled within a tile; safe from any thread.

        Its board is closed, so that a ``fill`` that waits for an interest map ends too.
        """
        self._threads.cancel()
        if self._steerer is not None:
            self._steerer.cancel()

    def close(self) -> None:
        """End the threads and let go of all memory; safe to call twice."""
        self.cancel()
        self._threads.close()
        self._targets.clear()

    def _path_store(self, options: RenderOptions, camera: Camera) -> PathStore:
        """Return what stores paths that follow the light."""
        from clsim.render.cache.path_store import PathStore

        kernel = build_kernel(options.features(self._data.features, camera, replay=True), self._data.tree)
        stored = options.lamp_paths if self._data.features.lamps_move else options.stored_paths
        limited = not (self._data.light_changes or options.lights_set)
        every = options.follow_every
        return PathStore(kernel, self._data, self._settings, stored, every, self._threads, limited=limited)

    def _shine(self, time_s: float) -> dict[str, Any]:
        """Let light be its mean over an exposure about that time; return the argument of the kernel that this changes.

        State from earlier frames tells nothing of another light.
        """
        if not self._data.light_changes:
            return {}
        half_s = 0.5 * self._shutter_s
        light = self._data.shine(time_s - half_s, time_s + half_s)
        if not np.array_equal(light, self._light):
            self.forget_light()
        self._light = light
        return {"scene": self._data.scene}

    def _record(self, tile: int) -> Any:
        planes = wp.zeros((len(self.names), tile), dtype=wp.float32, device=self._device)
        arguments = {
            "scene": self._data.scene,
            "camera": self._camera.at(0.0),
            "settings": self._settings,
            "first_pixel": 0,
            "out_planes": planes,
        }
        if self._steerer is None:
            arguments |= {"pixels": self._all, "out_bits": _as_bits(planes)}
        else:
            arguments |= {"pixels": 1, "corner_pass": False, "corners": self._corners} | self._steerer.arguments
        return record(self._kernel, tile, self._device, **arguments)

    def _render(self, changed: dict[str, Any], count: int) -> None:
        """Render so many pixels, or corners of pixels, with those arguments of the kernel that have changed."""
        if not self._tiles.run(count, changed):
            raise RenderCancelled

    def _pixels_to_duplicate(self) -> npt.NDArray[np.int32]:
        """Return the numbers of the duplicate pixels where all light is found by paths."""
        patches, every = self._options.duplicate_in, self._options.duplicate_every
        if patches is not None:
            return patches.pixels(self.width)
        return np.arange(0, self.width * self.height if every else 0, max(1, every), dtype=np.int32)

    def _target(self, out: Frame) -> tuple[Any, Any]:
        """Return the array that the kernel writes, and the same as bits: the frame's own memory on a CPU."""
        shape = (len(self.names), self.width * self.height)
        address = out.planes.ctypes.data if self._device.is_cpu else 0
        if address not in self._targets:
            if len(self._targets) == _MAX_TARGETS:
                self._targets.clear()
            on_host = self._device.is_cpu
            planes = self._host(out) if on_host else wp.empty(shape, dtype=wp.float32, device=self._device)
            self._targets[address] = (planes, _as_bits(planes))
        return self._targets[address]

    def _host(self, out: Frame) -> Any:
        shape = (len(self.names), self.width * self.height)
        return wp.array(ptr=out.planes.ctypes.data, shape=shape, dtype=wp.float32, device="cpu")
