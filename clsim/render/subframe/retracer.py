"""Host side of retraced.py: chosen pixels at chosen times."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import warp as wp

from clsim.errors import InputError
from clsim.frames import Fineness, Reflected, rendered_planes
from clsim.render.camera.camera import CameraData
from clsim.render.camera.pixel_width import pixel_of, widest_pixel
from clsim.render.device.launch import Threads, Tiles, record, tile_size
from clsim.render.kernel_input import settings_of
from clsim.render.motion.standstill import have_moved
from clsim.render.options import RenderOptions
from clsim.render.paths.integrator import build_kernel
from clsim.render.primary.effort import PrimarySetup, primary_rays_for
from clsim.render.sampling.sampling import stream_state
from clsim.render.scene_data import SceneData
from clsim.render.subframe.flat_pixels import INSTANTS
from clsim.render.subframe.motion_field_host import MotionFieldHost
from clsim.render.view import RenderCancelled
from clsim.scene import World

if TYPE_CHECKING:
    from clsim.render.subframe.flat_follower import FlatFollower
    from clsim.render.view import View

_RAYS_OF_A_PATH = 16
"""Primary rays at most that a pixel may get for what a path costs."""
_MOST_REQUESTS = 1 << 20
"""Requests of a launch, so that memory does not grow."""
_LEAST_REQUESTS = 64
"""Requests of a launch on a CPU that are worth a thread: each has corners of its own to trace, some µs."""


class Retracer:
    """One camera's pixels, traced where and when somebody asks.

    A pixel has the same bits at a time as in the frame of that time, as far as its planes are here: of frames with
    primary rays those that such rays find, and instead of radiance emission alone, unless light is cached on surfaces:
    then radiance is in the light of the last frame.

    Attributes:
        names: the planes.
        lit: whether radiance is whole; else it is emission alone.
        requests: how many were answered so far.
        samples: paths, or primary rays, traced so far.
    """

    def __init__(
        self,
        data: SceneData,
        options: RenderOptions,
        view: Callable[[], View] | None = None,
        by_frames: bool = False,
    ) -> None:
        """Build the kernel.

        Args:
            data: what is rendered, with a place for each of several instants; nothing else moves it.
            options: how it is rendered; as for the frames.
            view: returns what renders the frames: requests have its primary rays, and its radiance cache. Where there
                is one, it must be given.
            by_frames: whether of rays in soft shadows only those are traced that differ between the frames around,
                where light is cached at a pace: a pixel has its brightness to about 0.1 % then.

        Raises:
            InputError: frames have noise of their own, or the camera exposes for a while.
        """
        camera = data.world.camera
        if options.noise != "common":
            raise InputError(f"pixels can be traced between frames with `noise` common only, got {options.noise}")
        if camera.shutter_s > 0:
            raise InputError(
                f"pixels can be traced at instants only, but the camera exposes for {camera.shutter_s:g} s; expected 0"
            )
        self.names = rendered_planes(first_hit_rays=options.first_hit_rays > 0).names
        self.requests = self.samples = 0
        self._data, self._device = data, data.device
        self._first_hits = options.first_hit_rays
        self._view, self._in_cached_light, self._by_frames = view, options.light_cache, by_frames
        self.lit = self._in_cached_light or not self._first_hits
        self._features = features = options.features(data.features, camera, requests=True)
        self._shape = camera.height, camera.width
        self._motion_field: MotionFieldHost | None = None
        self._kernel = build_kernel(features, data.tree)
        clear_m = data.clear_m if self._first_hits else None
        self._camera = CameraData(camera, features, data.origin_m, self._device, clear_m)
        self._settings: Any = settings_of(options, camera, data.world.sensor)
        self._settings.stream = stream_state(options.seed, None)
        self._primary_setup = PrimarySetup(pixel_of(camera), features.sharp, features.lamp_light)
        self._widest_rad = widest_pixel(camera) if features.sharp and self._primary_setup.pixel[0] > 0.0 else 0.0
        if self._first_hits:
            data.add_texture_levels()
            self._settings.samples = self._first_hits
        # Most pixels need few of their primary rays.
        paths = -(-self._settings.samples // _RAYS_OF_A_PATH) if self._first_hits else self._settings.samples
        size = options.tile_pixels or tile_size(paths, self._device)
        self._threads = Threads(options.threads, self._device)
        self._tiles = Tiles(self._threads, self._record, "first", _MOST_REQUESTS, size, "count", _LEAST_REQUESTS)
        self._follower: FlatFollower | None = None
        # The last step, and whether the camera turned back in it.
        self._last_turn: tuple[tuple[int, int] | None, bool] = None, False

    def trace(self, pixels: npt.NDArray[np.int32], times_s: npt.NDArray[np.float64]) -> npt.NDArray[np.float32]:
        """Return the planes ``[C, N]`` of N requests.

        Args:
            pixels: y·width + x of each, ``[N]``.
            times_s: when each is traced [s], ``[N]``.

        Raises:
            RenderCancelled: ``cancel`` was called, before or meanwhile.
        """
        instants_s, numbers = np.unique(times_s, return_inverse=True)
        if self._data.still and 0 < len(pixels) <= _MOST_REQUESTS:
            return self._trace(pixels, instants_s, numbers)
        order = np.argsort(numbers, kind="stable")
        ends = np.searchsorted(numbers, np.arange(len(instants_s)), side="right", sorter=order)
        planes = np.empty((len(self.names), len(pixels)), np.float32)
        done = first = 0
        while first < len(instants_s):
            last = self._last_of(first, ends, done)
            for start in range(done, int(ends[last - 1]), _MOST_REQUESTS):
                part = order[start : min(start + _MOST_REQUESTS, int(ends[last - 1]))]
                planes[:, part] = self._trace(pixels[part], instants_s[first:last], numbers[part] - first)
            done, first = int(ends[last - 1]), last
        return planes

    def motion(self, start_s: float, end_s: float) -> npt.NDArray[np.float32] | None:
        """Return how far surfaces move on the image from one time to another, ``[3, 2, H, W]`` [pixels right and down].

        The first is the way of what a pixel sees at the start, the second that of what it sees at the end, the third
        the longest that leads over it or a neighbour. None where nothing moves meanwhile.

        Raises:
            RenderCancelled: ``cancel`` was called, before or meanwhile.
        """
        self._data.poses.forget()
        self._camera.forget()
        if rests(self._data.world, start_s, end_s):
            return None
        if self._motion_field is None:
            self._motion_field = MotionFieldHost(
                self._data, self._features, self._camera, self._settings, self._shape, self._threads
            )
        return self._motion_field.ways(start_s, end_s)

    def bounds(self) -> npt.NDArray[np.bool_] | None:
        """Return where more is seen in the last frame than one flat surface whose albedo its texture tells, ``[H, W]``.

        None where that is not known, since no rays go through pixels' corners, or objects move by themselves.
        """
        corners = self._corners
        if corners is None:
            return None
        if self._follower is None:
            from clsim.render.subframe.flat_follower import FlatFollower
            from clsim.render.subframe.flat_pixels import build_flat_pixels

            camera = self._camera.at_instants(np.zeros(1))
            given = {"scene": self._data.scene, "settings": self._settings, "camera": camera, "corners": corners}
            kernels = build_flat_pixels(self._features)
            self._follower = FlatFollower(kernels, self._shape, given, self._device, self._threads)
        return self._follower.bounds(corners)

    def steady_shadows(self) -> npt.NDArray[np.bool_]:
        """Return which pixels are lit alike, ray by ray, in the last two frames; see `PixelTracer.steady_shadows`."""
        assert self._view is not None, "bounds are asked for first"
        return self._view().light_cache_host.steady_shadows()

    def reflected(
        self, pixels: npt.NDArray[np.int64], light: npt.NDArray[np.float32], start_s: float, end_s: float,
        fineness: Fineness,
    ) -> Reflected:  # fmt: skip
        """Return what some pixels reflect from one time to that of the last frame; see `PixelTracer.reflected`."""
        assert self._follower is not None and self._view is not None, "bounds are asked for first"
        instants_s = np.linspace(start_s, end_s, INSTANTS)
        camera = self._camera.at_instants(instants_s)
        texels = primary_rays_for(self._view().effort.first_hit_rays, self._primary_setup).texels
        return self._follower.reflected(pixels, light, self._corners, camera, texels, fineness)

    def cancel(self) -> None:
        """Make a running ``trace`` or ``motion``, and later ones, raise RenderCancelled soon; safe from any thread."""
        self._threads.cancel()

    def close(self) -> None:
        """End the threads; safe to call twice."""
        self._threads.close()

    def _last_of(self, first: int, ends: npt.NDArray[np.int64], done: int) -> int:
        """Return the end of the run of instants, from ``first`` on, that one launch traces."""
        if self._data.still:
            return max(first + 1, int(np.searchsorted(ends, done + _MOST_REQUESTS, side="right")))
        alike = self._data.features.instants and not self._data.light_changes
        return min(first + (self._data.most_instants if alike else 1), len(ends))

    def _trace(
        self, pixels: npt.NDArray[np.int32], instants_s: npt.NDArray[np.float64], numbers: npt.NDArray[np.int64]
    ) -> npt.NDArray[np.float32]:
        if self._threads.cancelled:
            raise RenderCancelled
        self._data.move_to(instants_s)
        if self._data.light_changes:
            self._data.shine(float(instants_s[0]), float(instants_s[0]))
        if self._widest_rad > 0.0:
            pose = self._data.world.camera.motion.pose
            places = np.array([pose(time_s)[:3, 3] for time_s in instants_s.tolist()])
            self._settings.specks = self._data.specks(places, self._widest_rad)
        planes, bits = self._target(len(pixels))
        changed = {
            "scene": self._data.scene,
            "settings": self._settings,
            "camera": self._camera.at_instants(instants_s),
            "pixels": self._upload(pixels),
            "instants": self._upload(numbers),
            "out_planes": planes,
        }
        view = None if self._view is None else self._view()
        if not self._first_hits:
            changed["out_bits"] = bits
        elif self._in_cached_light and view is not None:
            cache_host = view.light_cache_host
            passed = self._passed(instants_s, cache_host.step_us)
            changed |= cache_host.shown | {"passed": wp.array(passed, dtype=wp.float32, device=self._device)}
            start_us, end_us = cache_host.step_us or (0, 0)
            shares = np.clip((instants_s * 1e6 - start_us) / max(end_us - start_us, 1), 0.0, 1.0)
            changed["light_passed"] = wp.array(shares, dtype=wp.float32, device=self._device)
        elif view is not None:
            changed["primary_rays"] = primary_rays_for(view.effort.first_hit_rays, self._primary_setup)
        if not self._tiles.run(len(pixels), changed):
            raise RenderCancelled
        out: npt.NDArray[np.float32] = planes.numpy()
        self.requests += len(pixels)
        self.samples += int(out[self.names.index("Samples")].sum())
        return out

    def _passed(self, instants_s: npt.NDArray[np.float64], step_us: tuple[int, int] | None) -> npt.NDArray[np.float64]:
        """Return the shares of a step that have passed by then; −1 where what its frames see is not asked."""
        if step_us is None or not self._by_frames or self._turns(step_us):
            return np.full(len(instants_s), -1.0)
        shares = (instants_s * 1e6 - step_us[0]) / (step_us[1] - step_us[0])
        return np.where((shares >= 0.0) & (shares <= 1.0), shares, -1.0)

    def _turns(self, step_us: tuple[int, int]) -> bool:
        """Whether the camera is farther from its start in the middle of a step than at its end."""
        if self._last_turn[0] != step_us:
            pose = self._data.world.camera.motion.pose
            start, middle, end = (pose(time_us * 1e-6) for time_us in (step_us[0], 0.5 * sum(step_us), step_us[1]))
            turns = bool(np.linalg.norm(middle - start) > np.linalg.norm(end - start))
            self._last_turn = step_us, turns
        return self._last_turn[1]

    def _record(self, tile: int) -> Any:
        planes, bits = self._target(tile)
        arguments = {
            "scene": self._data.scene,
            "camera": self._camera.at_instants(np.zeros(1)),
            "settings": self._settings,
            "first": 0,
            "count": 1,
            "pixels": self._upload(np.zeros(tile)),
            "instants": self._upload(np.zeros(tile)),
            "out_planes": planes,
        }
        if self._in_cached_light:
            from clsim.render.cache.light_cache_host import nothing_shown

            arguments |= nothing_shown(self._device)
        elif self._first_hits:
            arguments["primary_rays"] = primary_rays_for(self._first_hits, self._primary_setup)
        else:
            arguments["out_bits"] = bits
        return record(self._kernel, tile, self._device, **arguments)

    @property
    def _corners(self) -> Any:
        """What the corners of the last frame's pixels saw; None where flat surfaces cannot be told by them."""
        told = self._in_cached_light and self._data.still and self._features.textures and self._view is not None
        return self._view().corners if told and self._view is not None else None

    def _upload(self, values: Any) -> Any:
        return wp.array(values, dtype=wp.int32, device=self._device)

    def _target(self, requests: int) -> tuple[Any, Any]:
        planes: Any = wp.empty((len(self.names), requests), dtype=wp.float32, device=self._device)
        return planes, wp.array(ptr=planes.ptr, shape=planes.shape, dtype=wp.uint32, device=self._device)


def rests(world: World, start_s: float, end_s: float) -> bool:
    """Whether all of a world is where it was, at the middle and the end of a step."""
    if any(mesh.deformation is not None for mesh in world.meshes):
        return False
    later_s = 0.5 * (start_s + end_s), end_s
    pairs = ((motion, time_s) for motion in world.motions() for time_s in later_s if motion.duration_s > 0)
    return not any(have_moved(motion.pose(start_s), motion.pose(time_s)) for motion, time_s in pairs)
