"""From options to the stages that turn a scene into events: the one place that builds them, for every driver."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, Protocol

from clsim.detect.config import DetectorConfig
from clsim.errors import InputError
from clsim.frames import InterestBoard, PixelTracer, rendered_planes
from clsim.live.options import LiveOptions
from clsim.live.pacing.base_rate import BASE_FPS, base_fps, camera_px_s, fastest_px_s
from clsim.live.pacing.schedule import Schedule, truth_every
from clsim.live.pacing.time_steps import FINE_TOLERANCE_US, TOLERANCE_US, Retracing, way_px
from clsim.live.pipeline import Detector
from clsim.live.quality import Point
from clsim.live.sensors import cost_of, specimen_of
from clsim.live.settings import DetectionSettings, SceneSettings
from clsim.scene import World, load_world
from clsim.scene.driven import CAMERA
from clsim.scene.light.spectral import spectral_weights
from clsim.scene.modulation import missed
from clsim.truth.names import plane_names

if TYPE_CHECKING:
    from clsim.render import RenderOptions, SceneData, View
    from clsim.sensor import Specimen
    from clsim.sensor.settings import Optics, SensorSettings

FAST_PX = 2.0
"""Way from frame to frame beyond which frames alone miss too much of what is seen [pixels]."""
_SHORTEST_S = 1e-3
"""A run that is shorter is as long as whole frames are."""
_FOLLOWED = (
    f"things go more than {FAST_PX:g} pixels from frame to frame, so pixels are traced between frames too; "
    "`time` fixed leaves that out"
)


class DetectorMaker(Protocol):
    """What builds a detector."""

    def __call__(self, tracer: PixelTracer | None = None) -> Detector:
        """Build it; with a ``tracer`` it asks for pixels between frames."""
        ...


@dataclass(frozen=True)
class Stages:
    """What is rendered and how, and how events are found in it; nothing is built yet.

    Attributes:
        options: what the user chose, and the sampling that goes with the scene.
        world: the scene.
        fps: frames per simulated second.
        render: options of the renderer.
        detector: options of the detector.
        planes: names of the frames' planes.
        make_detector: builds the detector, its kernels too, with what traces pixels between frames, if anything does.
        steered: whether the detector's maps of interest steer the renderer.
        retracing: how pixels are traced between frames; None where they are not.
        notes: what was chosen since objects move fast, one sentence each.
        missed: what is missed since the camera goes fast, likewise.
    """

    options: LiveOptions
    world: World
    fps: float
    render: RenderOptions
    detector: DetectorConfig
    planes: tuple[str, ...]
    make_detector: DetectorMaker
    steered: bool
    retracing: Retracing | None = None
    notes: tuple[str, ...] = ()
    missed: tuple[str, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is asked for and will not be: by the scene, of what clsim lacks, and by options without use."""
        camera = self.world.camera
        costs = cost_of(self.options.sensor, camera.width, camera.height)
        return (*self.world.warnings, *unused_options(self.detector), *self._light_missed(), *self.missed, *costs)

    @property
    def chosen(self) -> tuple[str, ...]:
        """What was chosen and why, a sentence each: settings, how light is known, and when brightness is found."""
        from clsim.render import lamps_move
        from clsim.render.features.scene_features import light_stands_still

        point, name = self.options.point, self.world.name
        if not self.render.light_cache:
            light = f"`sampling` {point.sampling}: light is traced anew in each frame"
        elif light_stands_still(self.world) and not self.render.lights_set:
            light = f"light is cached on surfaces and not traced again: nothing but the camera of {name} moves"
        else:
            stored = point.lamp_paths if lamps_move(self.world) else point.stored_paths
            light = (
                f"light is cached on surfaces; what moves or shines differently in {name} changes it, so paths that "
                f"meet that are traced again, of {stored} or more in each cell"
            )
        times = f"brightness is found {self.fps:g} times a second, in frames"
        if self.retracing is not None:
            times += f", and between them where it changes, to {self.retracing.tolerance_us:g} µs"
        return f"`quality` {self.options.basis or 'of the options alone'}: {point.text()}", light, times

    def _light_missed(self) -> list[str]:
        """Return sentences about light that changes and will not be seen as it is."""
        from clsim.render import lamps_move

        found = [missed([*self.world.modulations(), *self.world.films()], self.fps)]
        # Unasked, what is between frames misses nothing that frames alone would have had.
        asked = self.retracing is not None and not self.notes
        if asked and self.detector.method == "irradiance" and lamps_move(self.world):
            found.append(
                f"lamps move in {self.world.name}, and `method` irradiance takes their light, or what of it comes by "
                f"way of other surfaces, for a straight line from frame to frame, {self.fps:g} a second; `quality` "
                "exact follows it between frames"
            )
        if self.world.light_changes() and self.detector.method == "esim-ad" and self.detector.gate == "delta-r":
            found.append("`gate` delta-r sees what moves, but no light that changes: expected radiance")
        return [sentence for sentence in found if sentence is not None]

    def board(self, missing: Literal["refuse", "wait", "newest"]) -> InterestBoard | None:
        """Return a board for the maps of interest if anything asks for them; see InterestBoard for ``missing``."""
        return InterestBoard(missing) if self.steered else None

    def build_detector(self, schedule: Schedule | None = None) -> Detector:
        """Build the detector; where pixels are traced between frames, at the times of ``schedule`` or the world's."""
        tracer = None if self.retracing is None else self.retracing.tracer(self.world, schedule)
        return self.make_detector(tracer)

    def scene_data(self, render: RenderOptions | None = None) -> SceneData:
        """Copy the world to the device that renders; its kernels, those for ``render``, are compiled meanwhile.

        Args:
            render: how a view will render it; None takes ``self.render``.
        """
        from clsim.render import SceneData

        return SceneData(self.world, self.render.device, self.render.tree, ahead=render or self.render)

    def shown_by(self, view: View) -> View:
        """Return the view, once what traces pixels between frames knows that it renders them."""
        if self.retracing is not None:
            self.retracing.views[:] = [view]
        return view

    @property
    def in_step(self) -> bool:
        """Whether no frame is rendered before the last one's events are found.

        Pixels are traced between frames in the light of the last one, and with as many rays.
        """
        return self.retracing is not None and (self.render.light_cache or self.options.governed)


def load_options_world(options: SceneSettings) -> World:
    """Load the scene that options name, with the camera that they describe; raises InputError."""
    world = load_world(
        options.scene,
        resolution=options.resolution,
        strict=options.strict,
        camera_path=options.camera_path,
        camera_axes=options.camera_axes,
        camera_interpolation=options.camera_interpolation,
    )
    if options.resolution is None and options.sensor is not None:
        world = _seen_by(world, options.sensor.optics)
    return in_colours_of(options.sensor, world)


def in_colours_of(sensor: SensorSettings | None, world: World) -> World:
    """Return the world seen in the colours that a sensor's file asks for; they come before the scene's."""
    if sensor is None:
        return world
    optics, seen = sensor.optics, world.sensor
    return replace(world, sensor=replace(seen, spectral=optics.spectral or seen.spectral, mosaic=optics.mosaic))


def alone(world: World) -> World:
    """Return a world that one camera sees; if it has several, with a warning."""
    if not world.rig:
        return world
    names = ", ".join(mount.name for mount in world.rig)
    told = (
        f"{world.name} has the cameras {names}, but this sees from where they are mounted; use clsim live or "
        "clsim.RigSimulator"
    )
    return replace(world, warnings=(*world.warnings, told))


def plan_stages(
    options: LiveOptions, world: World | None = None, *, lights_set: bool = False, driven: Collection[str] = ()
) -> Stages:
    """Load the scene, unless ``world`` is given, and choose devices and settings; raises InputError.

    Where ``lights_set`` says that lights change from outside, their light does not stand still. What ``driven`` names
    is moved from outside: it may go fast, and the camera need not stand still.
    """
    from clsim.render import RenderOptions, check_device, lamps_move, precompile_headers

    if world is None:
        world = alone(load_options_world(options))
    by_frames = options.time in ("auto", "fixed") or lamps_move(world)
    fps = options.fps or (world.fps if by_frames else _ending_in_time(base_fps(world), options))
    fast = _goes_fast(world, fps, driven) and not lights_set
    unasked, options = options.time == "auto", options.settled(fast)
    notes = (_FOLLOWED,) if unasked and options.time == "adaptive" else ()
    told = unasked and options.pace == "max" and CAMERA not in driven
    missed_by = _missed_by_frames(camera_px_s(world) / fps, fps) if told else ()
    point = options.point
    steered = point.sampling == "adaptive"
    detector = _detector_config(options, point, options.sensor, world)
    nears = options.ideal and point.sampling == "cached" and options.time == "fixed"
    render = RenderOptions(
        spp=point.spp,
        probe_spp=point.probe_spp if point.sampling != "uniform" else None,
        probe_every=point.probe_every,
        first_hit_rays=point.first_hit_rays,
        light_cache=point.sampling == "cached",
        stored_paths=point.stored_paths,
        lamp_paths=point.lamp_paths,
        follow_every=point.follow_every,
        first_frame_error=point.first_frame_error,
        lights_set=lights_set,
        light_hz=None if options.time == "fixed" else BASE_FPS,
        # Where light changes by itself, shares that are counted by other rays in each frame would make it flicker more.
        fires_at=detector.fires_at if nears and not (world.light_changes() or lights_set) else None,
        fps=fps,
        seed=options.seed,
        noise=point.noise,
        sampler=point.sampler,
        truth=plane_names(options.truth),
        truth_every=truth_every(fps, options.frame_rate),
        follow_specular=options.follow_specular,
        max_depth=options.max_depth,
        threads=options.threads,
        device=options.render_device,
    )
    check_device(options.render_device)
    # Meanwhile the OpenCL device may have to be tried, by a program of its own.
    precompile_headers(options.render_device)
    planes = rendered_planes(first_hit_rays=point.first_hit_rays > 0, truth=render.truth).names
    size = world.camera.width, world.camera.height
    specimen = specimen_of(options.sensor, options.seed, world.sensor.lux_per_unit / world.sensor.scale)
    retracing = None
    if options.time != "fixed":
        if world.sensor.mosaic is not None:
            raise InputError(f"a `sensor` with a color_filter needs `time` fixed, got {options.time}")
        if world.camera.shutter_s > 0:
            raise InputError(
                f"`time` {options.time} finds brightness at instants, but the camera of {world.name} exposes for "
                f"{world.camera.shutter_s:g} s; expected 0"
            )
        tolerance_us = options.time_tolerance_us or FINE_TOLERANCE_US.get(options.basis, TOLERANCE_US)
        retracing = Retracing(tolerance_us, way_px(options.time), render)
    make_detector = detector_maker(detector, size, planes, options.opencl, specimen, retracing)
    return Stages(options, world, fps, render, detector, planes, make_detector, steered, retracing, notes, missed_by)


def _ending_in_time(fps: float, options: LiveOptions) -> float:
    """Return the least rate, from ``fps`` on, at which the run ends with a frame; of a rate that nobody asked for."""
    duration_s = options.duration_s or 0.0
    if duration_s < _SHORTEST_S or options.frame_count is not None or options.frame_rate is not None or options.loop:
        return fps
    return math.ceil(duration_s * fps - 1e-6) / duration_s


def _goes_fast(world: World, fps: float, driven: Collection[str]) -> bool:
    """Whether rigid objects go so far from frame to frame, before a camera that stands still, that much is missed."""
    from clsim.render import camera_watches

    # Before such a camera few pixels change. One that exposes sees no instants between frames.
    watched = camera_watches(world) and not driven and world.camera.shutter_s == 0
    # Nor is it known between frames what comes from a neighbour, behind another filter.
    watched = watched and world.sensor.mosaic is None
    return watched and fastest_px_s(world) / fps > FAST_PX


def _missed_by_frames(camera_px: float, fps: float) -> tuple[str, ...]:
    """Return what a camera misses if objects go so far from frame to frame, and what to do."""
    if camera_px <= FAST_PX:
        return ()
    enough = fps * 2 ** math.ceil(math.log2(camera_px))
    return (
        f"what the camera sees goes {camera_px:.1f} pixels from frame to frame, and events between are missed or late; "
        f"use `fps` {enough:g}",
    )


def detector_maker(
    config: DetectorConfig,
    size: tuple[int, int],
    planes: tuple[str, ...],
    opencl: str | None,
    specimen: Specimen | None = None,
    retracing: Retracing | None = None,
) -> DetectorMaker:
    """Choose the device now, so that a wrong name is told at once; what is returned builds the kernels.

    ``size`` is the width and height of the frames, ``specimen`` the sensor: None is the ideal one. ``retracing``
    says which pixels are traced between frames, by what the maker is given.
    """
    from clsim.detector import Detector as StreamDetector
    from clsim.detector import check_sensor, recorded_detector
    from clsim.opencl.device import choose_device

    device = None if config.needs_numpy else choose_device(opencl)

    if specimen is not None:
        check_sensor(config, specimen)

    def make(tracer: PixelTracer | None = None) -> Any:
        detector: Any
        if tracer is not None and retracing is not None:
            detector = StreamDetector(
                config, *size, planes, device=device, specimen=specimen,
                tracer=tracer, tolerance_us=retracing.tolerance_us, way_px=retracing.way_px,
            )  # fmt: skip
        else:
            detector = recorded_detector(config, *size, planes, device=device, specimen=specimen)
        if isinstance(detector, StreamDetector):
            detector.prepare()
        return detector

    return make


def unused_options(config: DetectorConfig) -> tuple[str, ...]:
    """Return a sentence about options that change nothing."""
    unused = config.unused()
    if not unused:
        return ()
    return (f"{config.who()} has no use for {', '.join(f'`{name}`' for name in unused)}",)


def _seen_by(world: World, optics: Optics) -> World:
    """Return the world with a camera of this size and field of view, as far as they are known."""
    chosen = {
        name: getattr(optics, name) for name in ("width", "height", "fov_deg") if getattr(optics, name) is not None
    }
    return replace(world, camera=replace(world.camera, **chosen)) if chosen else world


def _detector_config(
    options: DetectionSettings, point: Point, seen_by: SensorSettings | None, world: World
) -> DetectorConfig:
    sensor = world.sensor
    own = None if seen_by is None else seen_by.threshold
    on = own.on if own is not None and own.on is not None else sensor.threshold_on
    off = own.off if own is not None and own.off is not None else sensor.threshold_off
    on, off = options.threshold or (on, off)
    return DetectorConfig(
        method=point.method,
        gate=point.gate,
        event_rule=point.event_rule,
        threshold_on=on,
        threshold_off=off,
        window=point.window,
        history=options.history,
        confidence=options.confidence,
        scale=sensor.scale,
        floor=sensor.floor,
        luminance="rec709" if sensor.spectral == "luminance" else spectral_weights(sensor.spectral),
        mosaic=sensor.mosaic,
    )
