"""Prototypes of ideas that may improve regressed brightness, and the frames they work on (docs/research).

A prototype is a row of a table: it turns noisy frames into the level of each pixel, or into events. The events that
should be are ESIM's on clean frames whose common random numbers have another seed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.ndimage import map_coordinates, uniform_filter

from clsim.detect.config import DetectorConfig
from clsim.detect.float64.fit import Fit, empty_fit, fit_pixels, put_fit
from clsim.detect.float64.observation import feature_names, observe
from clsim.detect.float64.rule import Step, apply_rule
from clsim.detector import Detector
from clsim.events import EventBatch
from clsim.frames import Frame, page_aligned
from clsim.render import PathTracer, RenderOptions
from clsim.scene import load_world

F64 = npt.NDArray[np.float64]
LUMINANCE = (0.2126, 0.7152, 0.0722)
FLOOR = 1e-4
REFERENCE_SEED = 101
GEOMETRY = ("Depth", "Nx", "Ny", "Nz")
VARIANCE = "Variance.Luminance"


@dataclass(frozen=True)
class Take:
    """What makes a sequence of frames."""

    scene: str
    spp: int
    seed: int = 0
    noise: Any = "common"
    sampler: Any = "pcg"
    max_depth: int = 8

    @property
    def name(self) -> str:
        """A file name."""
        return f"{self.scene}-{self.noise}-{self.spp}-{self.seed}-{self.sampler}-{self.max_depth}"


@dataclass
class Frames:
    """A sequence: planes ``[N, C, H, W]``, their names, and times [µs]."""

    planes: npt.NDArray[np.float32]
    names: tuple[str, ...]
    times: npt.NDArray[np.int64]

    def plane(self, name: str) -> F64:
        """Return one plane ``[N, H, W]``."""
        return self.planes[:, self.names.index(name)].astype(np.float64)

    @cached_property
    def luminance(self) -> F64:
        """Luminance ``[N, H, W]``."""
        return weigh(self, "RGB")

    @cached_property
    def variance(self) -> F64:
        """Variance of the luminance, a mean of samples."""
        return self.plane(VARIANCE)

    def with_luminance(self, y: F64) -> Frames:
        """Return grey frames of luminance ``y``."""
        planes = self.planes.copy()
        for channel in "RGB":
            planes[:, self.names.index(channel)] = y
        return Frames(planes, self.names, self.times)


@dataclass
class Studio:
    """Renders takes, and keeps them in a folder."""

    folder: Path
    size: tuple[int, int]
    count: int
    threshold: float
    reference_spp: int
    _references: dict[str, EventBatch] = field(default_factory=dict)

    def take(self, take: Take) -> Frames:
        """Return the frames of a take."""
        path = self.folder / f"{take.name}.npz"
        if not path.exists():
            planes, names, times = self._render(take)
            np.savez(path, planes=planes, names=names, times=times)
        stored = np.load(path)
        return Frames(stored["planes"], tuple(str(name) for name in stored["names"]), stored["times"])

    def _render(self, take: Take) -> tuple[npt.NDArray[np.float32], tuple[str, ...], list[int]]:
        tracer = PathTracer(
            load_world(take.scene, resolution=self.size),
            RenderOptions(spp=take.spp, frames=self.count, seed=take.seed, noise=take.noise, sampler=take.sampler,
                          max_depth=take.max_depth, variances=take.spp > 1),
        )  # fmt: skip
        frame = Frame(page_aligned((len(tracer.names), tracer.height, tracer.width)), tracer.names)
        planes, times = [], []
        for k in range(self.count):
            tracer.fill(k, frame)
            planes.append(frame.planes.copy())
            times.append(frame.time_us)
        names = tracer.names
        tracer.close()
        return np.stack(planes), names, times

    def reference(self, scene: str) -> EventBatch:
        """Return the events that should be."""
        if scene not in self._references:
            self._references[scene] = self.clean(scene, REFERENCE_SEED)
        return self._references[scene]

    def clean(self, scene: str, seed: int) -> EventBatch:
        """Return ESIM's events on clean frames."""
        frames = self.take(Take(scene, self.reference_spp, seed))
        return self.fire(esim(frames), frames.times)

    def fire(self, levels: F64, times: npt.NDArray[np.int64]) -> EventBatch:
        """Turn levels ``[N, H, W]`` into events."""
        config = DetectorConfig(threshold_on=self.threshold, threshold_off=self.threshold)
        flat = levels.reshape(len(levels), -1)
        pixels, ref, events = np.arange(flat.shape[1]), flat[0].copy(), []
        for k in range(1, len(flat)):
            step = Step(int(times[k - 1]), int(times[k]), flat[k - 1], flat[k], ref)
            outcome = apply_rule(step, pixels, levels.shape[2], config)
            ref = outcome.ref
            events.append(outcome.events)
        return np.concatenate(events)


@dataclass
class Case:
    """The noisy frames that a row works on."""

    studio: Studio
    take: Take

    @cached_property
    def frames(self) -> Frames:
        """Its frames."""
        return self.studio.take(self.take)

    def sibling(self, **changes: Any) -> Case:
        """Return the same case but for some of its take."""
        return Case(self.studio, replace(self.take, **changes))


Row = Callable[[Case], Any]
"""Makes levels ``[N, H, W]``, or events."""


def weigh(frames: Frames, channels: str, prefix: str = "") -> F64:
    """Return the luminance of three planes."""
    parts = (w * frames.plane(prefix + c) for w, c in zip(LUMINANCE, channels, strict=True))
    return np.asarray(sum(parts))


def log(y: F64) -> F64:
    """Return log brightness."""
    return np.log(np.maximum(y, FLOOR))


def esim(frames: Frames) -> F64:
    """Return levels without a regression."""
    return log(frames.luminance)


def fitted(frames: Frames, **options: Any) -> F64:
    """Return the level of a regression (or what ``options`` have as method) at every pixel."""
    height, width = frames.planes.shape[2:]
    config = DetectorConfig(**{"method": "wlr-esim", "floor": FLOOR, **options})
    detector = Detector(config, width, height, frames.names)
    levels = []
    for frame in each(frames):
        detector.step(frame)
        levels.append(detector.level().astype(np.float64))
    detector.close()
    return np.stack(levels)


def each(frames: Frames) -> list[Frame]:
    """Return one frame after the other."""
    result = []
    for k, planes in enumerate(frames.planes):
        frame = Frame(page_aligned(planes.shape), frames.names, int(frames.times[k]), k)
        frame.planes[...] = planes
        result.append(frame)
    return result


def box(values: F64, side: int) -> F64:
    """Return means over side × side pixels, clipped at the border."""
    inside = uniform_filter(np.ones(values.shape[1:]), side, mode="constant")
    return np.asarray(uniform_filter(values, (0, side, side), mode="constant") / inside)


def wlr(**options: Any) -> Row:
    """Return a row that regresses everywhere."""
    return lambda case: fitted(case.frames, **options)


def gated(**options: Any) -> Row:
    """Return a row that regresses where a gate opens."""

    def row(case: Case) -> EventBatch:
        height, width = case.frames.planes.shape[2:]
        c = case.studio.threshold
        detector = Detector(DetectorConfig(threshold_on=c, threshold_off=c, **options), width, height,
                            case.frames.names)  # fmt: skip
        events = np.concatenate([detector.step(frame) for frame in each(case.frames)])
        detector.close()
        return events

    return row


def offset(share: float, **options: Any) -> Row:
    """Return a row that regresses ln(Y + share · median)."""

    def row(case: Case) -> F64:
        shift = share * float(np.median(case.frames.luminance))
        levels = fitted(case.frames.with_luminance(case.frames.luminance + shift), **options)
        return log(np.exp(levels) - shift)

    return row


def fixed_share(share: float, **options: Any) -> Row:
    """Return a row whose luminance is ``share`` the pixel's own, the rest the fit's."""

    def row(case: Case) -> F64:
        return log(share * case.frames.luminance + (1 - share) * np.exp(fitted(case.frames, **options)))

    return row


def paired_share(**options: Any) -> Row:
    """Return a row whose share of the pixel comes from halves of the samples.

    The noise of what changed since frame 0 is half the difference of the halves' changes; set against the change of
    the residual, both as means over 5 × 5 pixels.
    """

    def row(case: Case) -> F64:
        half = case.sibling(spp=case.take.spp // 2)
        a, b = half.frames, half.sibling(seed=case.take.seed + 1).frames
        shared = tuple(name for name in a.names if not name.startswith("Variance."))
        planes = [f.planes[:, [f.names.index(name) for name in shared]] for f in (a, b)]
        both = Frames((planes[0] + planes[1]) / 2, shared, a.times)
        fit = np.exp(fitted(both, **options))
        residual = both.luminance - fit
        noise = (since_start(a.luminance) - since_start(b.luminance)) / 2
        expected, found = box(noise**2, 5), box(since_start(residual) ** 2, 5)
        share = np.clip(1 - expected / np.maximum(found, 1e-30), 0, 1)
        return log(fit + share * since_start(residual))

    return row


def since_start(values: F64) -> F64:
    """Return what changed since the first frame."""
    return values - values[0]


def chosen(first: dict[str, Any], second: dict[str, Any], factor: float) -> Row:
    """Return a row that takes the second fit where the first one's residual is more than ``factor`` times the noise."""

    def row(case: Case) -> F64:
        level = fitted(case.frames, **second)
        fit = numpy_fit(case.frames, **first)
        noise = box(case.frames.variance, first["window"])
        smooth = fit.residual.reshape(level.shape) <= factor * noise
        return np.where(smooth, log(fit.alpha.reshape(level.shape)), level)

    return row


def log_shrunk(share: float, **options: Any) -> Row:
    """Return a row that regresses ln(Y + share · median) and shrinks; the variance of a log is V / (Y + …)²."""

    def row(case: Case) -> F64:
        shift = share * float(np.median(case.frames.luminance))
        fit = numpy_fit(case.frames, shift=shift, **options)
        return log(np.exp(fit.alpha.reshape(case.frames.luminance.shape)) - shift)

    return row


def numpy_fit(frames: Frames, extra: F64 | None = None, shift: float | None = None, **options: Any) -> Fit:
    """Return the fits of all pixels of all frames, one after the other.

    ``extra [N, H, W]`` is a further feature; with ``shift``, ln(luminance + shift) takes the place of luminance.
    """
    config = DetectorConfig(method="wlr-esim", **options)
    planes = feature_names(config, frames.names)
    pixels = np.arange(frames.luminance[0].size)
    all_fits = empty_fit(len(frames.times) * len(pixels), 2 + len(planes) + (extra is not None))
    for k, frame in enumerate(each(frames)):
        seen = observe(frame, planes, config)
        if extra is not None:
            seen.features = np.concatenate([seen.features, extra[k][..., None]], axis=-1)
        if shift is not None:
            y = np.maximum(seen.brightness + shift, FLOOR)
            seen.brightness = np.log(y)
            if seen.brightness_variance is not None:
                seen.brightness_variance = seen.brightness_variance / y**2
        put_fit(all_fits, pixels + k * len(pixels), fit_pixels([seen], pixels, config))
    return all_fits


def visibility(side: int, **options: Any) -> Row:
    """Return a row with the light that comes straight from lamps, over albedo, as a feature (box mean)."""

    def row(case: Case) -> F64:
        direct = case.sibling(max_depth=2).frames
        share = direct.luminance / surface(direct)
        fit = numpy_fit(case.frames, box(share, side), **options)
        return log(fit.alpha.reshape(share.shape))

    return row


def surface(frames: Frames) -> F64:
    """Return the luminance of the albedo; 1 where there is none."""
    albedo = weigh(frames, "RGB", "Albedo.")
    return np.where(albedo > 1e-2, albedo, 1.0)


def split_albedo(**options: Any) -> Row:
    """Return a row that regresses what falls on the surface, and gives the albedo back afterwards."""

    def row(case: Case) -> F64:
        albedo = surface(case.frames)
        frames = case.frames.with_luminance(case.frames.luminance / albedo)
        frames.planes[:, frames.names.index(VARIANCE)] /= albedo.astype(np.float32) ** 2
        return log(np.exp(fitted(frames, features=GEOMETRY, **options)) * albedo)

    return row


def reprojected(weight: float, **options: Any) -> Row:
    """Return a row whose luminance is blended with the frame before's where the same surface was seen."""

    def row(case: Case) -> F64:
        frames = case.frames
        camera = load_world(case.take.scene, resolution=case.studio.size).camera
        height, width = frames.luminance.shape[1:]
        focal = width / (2 * np.tan(np.radians(camera.fov_deg) / 2))
        ys, xs = np.mgrid[0:height, 0:width]
        view = np.stack([(xs + 0.5 - width / 2) / focal, -(ys + 0.5 - height / 2) / focal, -np.ones(xs.shape)], -1)
        view /= np.linalg.norm(view, axis=-1, keepdims=True)
        depth, blended = frames.plane("Depth"), [frames.luminance[0]]
        for k in range(1, len(frames.times)):
            now, before = (camera.motion.pose(float(frames.times[i]) * 1e-6) for i in (k, k - 1))
            world = now[:3, 3] + depth[k][..., None] * (view @ now[:3, :3].T)
            seen = (world - before[:3, 3]) @ before[:3, :3]
            z = np.minimum(seen[..., 2], -1e-6)
            at = [height / 2 + focal * seen[..., 1] / z - 0.5, width / 2 - focal * seen[..., 0] / z - 0.5]
            old_depth = map_coordinates(depth[k - 1], at, order=1, mode="nearest")
            old = map_coordinates(blended[-1], at, order=1, mode="nearest")
            same = np.abs(old_depth - np.linalg.norm(seen, axis=-1)) < 0.02 * depth[k]
            same &= (np.abs(at[0] - (height - 1) / 2) <= height / 2) & (np.abs(at[1] - (width - 1) / 2) <= width / 2)
            blended.append(np.where(same, weight * old + (1 - weight) * frames.luminance[k], frames.luminance[k]))
        mixed = frames.with_luminance(np.stack(blended))
        return fitted(mixed, **options) if options else esim(mixed)

    return row


def other(row: Row, **changes: Any) -> Row:
    """Return a row that sees another take."""
    return lambda case: row(case.sibling(**changes))


def plain(case: Case) -> F64:
    """ESIM, as a row."""
    return esim(case.frames)
