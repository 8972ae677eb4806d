"""Measure ideas that may improve regressed brightness, each on the same noisy frames (docs/experiments.md).

Scenes are rendered small, and kept in a folder. Every row turns frames into the level of each pixel, or into events;
all are scored against ESIM on clean frames whose common random numbers have another seed, as is the ceiling, ESIM on
clean frames of a third seed.

python tools/tradeoff_experiments.py --cache FOLDER --out tables.md
python tools/tradeoff_experiments.py --cache FOLDER --groups windows,shares --scenes moving-light --spp 8
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.ndimage import map_coordinates, uniform_filter

from clsim.cli.parse import resolution as parse_resolution
from clsim.detect.config import DetectorConfig
from clsim.detect.detector import Detector
from clsim.detect.reference_fit import Fit, empty_fit, fit_pixels, put_fit
from clsim.detect.reference_observation import feature_names, observe
from clsim.detect.reference_rule import Step, apply_rule
from clsim.events import EventBatch
from clsim.frames import Frame, page_aligned
from clsim.render import PathTracer, RenderOptions
from clsim.scene import load_world
from clsim.score import Score, score

F64 = npt.NDArray[np.float64]
LUMINANCE = (0.2126, 0.7152, 0.0722)
FLOOR = 1e-4
REFERENCE_SEED, CEILING_SEED = 101, 202
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


LINEAR: dict[str, Any] = {"regress": "linear", "bandwidth_h": 0.5}
BEST: dict[str, Any] = {**LINEAR, "window": 9, "shrink": 1.5}
CLOSE: dict[str, Any] = {"box": 3, "gate_scale": 0.7}
GROUPS: dict[str, tuple[str, dict[str, Row]]] = {
    "windows": ("Log or luminance, window and bandwidth", {
        "esim": plain,
        **{f"log K{k}": wlr(window=k) for k in (3, 5, 7, 13)},
        **{f"log K{k} h.5": wlr(window=k, bandwidth_h=0.5) for k in (7, 9, 13)},
        "ln(Y + .3 median) K9 h.5": offset(0.3, window=9, bandwidth_h=0.5),
        "linear K7 h1": wlr(window=7, regress="linear"),
        "linear K13 h1": wlr(window=13, regress="linear"),
        **{f"linear K{k} h.5": wlr(window=k, **LINEAR) for k in (7, 9, 13)},
    }),
    "shares": ("How much the pixel's own value counts", {
        "linear K9 h.5": wlr(window=9, **LINEAR),
        **{f"… {share:g} of the pixel": fixed_share(share, window=9, **LINEAR) for share in (0.25, 0.5)},
        **{f"… shrink {c:g}": wlr(window=9, shrink=c, **LINEAR) for c in (1.0, 1.5, 2.0)},
        **{f"K{k}, shrink 1.5": wlr(window=k, shrink=1.5, **LINEAR) for k in (7, 13)},
        "K9, share by paired halves": paired_share(window=9, **LINEAR),
        "K13, but K7 where the residual is more than noise": chosen(
            {**LINEAR, "window": 13}, {**BEST, "window": 7}, 1.5),
        "h .5, but .25 where the residual is more than noise": chosen(
            {**LINEAR, "window": 9}, {**LINEAR, "window": 9, "bandwidth_h": 0.25}, 1.5),
        "log, shrink 1.5": log_shrunk(0, **BEST),
        "ln(Y + .3 median), shrink 1.5": log_shrunk(0.3, **BEST),
    }),
    "gates": ("Behind the radiance gate", {
        "esim": plain,
        "log K13 h1, box 5, s 1 (the first default)": gated(),
        "log K13 h1, box 3, s .7": gated(**CLOSE),
        **{f"linear K9 h.5, shrink 1.5, box {b}, s {s:g}": gated(box=b, gate_scale=s, **BEST)
           for b in (1, 3, 5) for s in (1.0, 0.7)},
        "linear K13 h.5, shrink 1.5, box 3, s .7": gated(**{**BEST, "window": 13}, **CLOSE),
        "no gate: linear K9 h.5, shrink 1.5": wlr(**BEST),
    }),
    "summary": ("What a user can choose", {
        "esim": plain,
        "first default: radiance log K13": gated(),
        "radiance linear K9": gated(**BEST, **CLOSE),
        "radiance linear K13": gated(**{**BEST, "window": 13}, **CLOSE),
        "irradiance K7": wlr(method="irradiance", window=7),
    }),
    "albedo": ("Albedo split out", {
        "log K13": wlr(window=13),
        "log K13, split": split_albedo(window=13),
        "linear K9 h.5, shrink 1.5": wlr(**BEST),
        "linear K9 h.5, shrink 1.5, split": split_albedo(**BEST),
    }),
    "visibility": ("Light straight from lamps as a feature", {
        "linear K9 h.5": wlr(window=9, **LINEAR),
        **{f"… and box {b} of direct light": visibility(b, window=9, **LINEAR) for b in (3, 5)},
        "linear K9 h.5, shrink 1.5": wlr(**BEST),
    }),
    "history": ("History", {
        "linear K9 h.5, shrink 1.5": wlr(**BEST),
        "… T = 3": wlr(history=3, **BEST),
        "… reprojected, half": reprojected(0.5, window=9, **LINEAR),
        "esim reprojected, half": reprojected(0.5),
    }),
    "noise": ("Random numbers", {
        **{f"independent: {name}": other(row, noise="independent") for name, row in {
            "esim": plain,
            **{f"log K13 h1, T = {t}": wlr(window=13, history=t) for t in (1, 3)},
            **{f"linear K13 h1, T = {t}": wlr(window=13, history=t, regress="linear") for t in (1, 3)},
            "linear K9 h.5, T = 3": wlr(window=9, history=3, **LINEAR),
            "linear K9 h.5, reprojected, .8": reprojected(0.8, window=9, **LINEAR),
        }.items()},
        **{f"{label}: {name}": other(row, sampler=sampler)
           for label, sampler in {"common": "pcg", "common Sobol": "sobol"}.items()
           for name, row in {
               "esim": plain,
               "log K13 h1": wlr(window=13),
               "linear K9 h.5, shrink 1.5": wlr(**BEST),
           }.items()},
    }),
}  # fmt: skip
"""Tables: a title, and rows by their name."""


def main() -> None:
    """Read the command line, make the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cache", type=Path, required=True, help="folder of rendered frames")
    parser.add_argument("--scenes", default="two-boxes,moving-light,cornell")
    parser.add_argument("--spp", default="2,8,32")
    parser.add_argument("--groups", default=",".join(GROUPS))
    parser.add_argument("--resolution", default="96x72")
    parser.add_argument("--frames", type=int, default=48)
    parser.add_argument("--threshold", type=float, default=0.2)
    parser.add_argument("--reference-spp", type=int, default=1024)
    parser.add_argument("--out", type=Path, help="Markdown file; default: standard output")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--plot", type=Path, help="PNG file: strict F1 of the first group's rows over samples a pixel")
    arguments = parser.parse_args()
    arguments.cache.mkdir(parents=True, exist_ok=True)
    size = parse_resolution(arguments.resolution)
    studio = Studio(arguments.cache, size, arguments.frames, arguments.threshold, arguments.reference_spp)
    scenes, spps = arguments.scenes.split(","), [int(n) for n in arguments.spp.split(",")]
    results = {name: measure(studio, name, scenes, spps) for name in arguments.groups.split(",")}
    ceiling = {scene: judge(studio, scene, studio.clean(scene, CEILING_SEED)) for scene in scenes}
    text = "\n".join(table(GROUPS[name][0], rows, scenes, spps, ceiling) for name, rows in results.items())
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(results, indent=1))
    if arguments.plot is not None:
        plot(arguments.plot, next(iter(results.values())), scenes, spps, ceiling)
    if arguments.out is None:
        print(text)
    else:
        arguments.out.write_text(text)


Figures = dict[str, float]


def measure(studio: Studio, group: str, scenes: list[str], spps: list[int]) -> dict[str, dict[str, Figures]]:
    """Return the scores of each row, by "scene spp"."""
    rows: dict[str, dict[str, Figures]] = {label: {} for label in GROUPS[group][1]}
    for scene in scenes:
        for spp in spps:
            case = Case(studio, Take(scene, spp))
            for label, row in GROUPS[group][1].items():
                made = row(case)
                events = made if made.dtype.names else studio.fire(made, case.frames.times)
                rows[label][f"{scene} {spp}"] = judge(studio, scene, events)
                print(f"{group}: {scene} {spp} spp, {label}: {rows[label][f'{scene} {spp}']}", file=sys.stderr)
    return rows


def judge(studio: Studio, scene: str, events: EventBatch) -> Figures:
    """Return F1, strict F1 and events per reference event."""
    found: Score = score(events, studio.reference(scene), *studio.size, fps_of(scene))
    return {"f1": found.f1, "strict": found.strict_f1, "events": found.events / found.reference_events}


@cache
def fps_of(scene: str) -> float:
    """Return a scene's frame rate."""
    return load_world(scene).fps


def table(
    title: str, rows: dict[str, dict[str, Figures]], scenes: list[str], spps: list[int], ceiling: dict[str, Figures]
) -> str:
    """Return a Markdown table."""
    columns = [f"{scene} {spp}" for scene in scenes for spp in spps]
    lines = [f"### {title}\n", "| F1 (strict F1) | " + " | ".join(columns) + " |", "|---" * (len(columns) + 1) + "|"]
    for label, figures in rows.items():
        lines.append(f"| {label} | " + " | ".join(cell(figures[column]) for column in columns) + " |")
    lines.append("| ceiling | " + " | ".join(cell(ceiling[scene]) for scene in scenes for _ in spps) + " |")
    return "\n".join(lines) + "\n"


def plot(
    path: Path, rows: dict[str, dict[str, Figures]], scenes: list[str], spps: list[int], ceiling: dict[str, Figures]
) -> None:
    """Draw strict F1 over samples a pixel, a panel for each scene."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4 * len(scenes), 3.6), layout="constrained")
    panels = np.atleast_1d(figure.subplots(1, len(scenes), sharey=True))
    for axes, scene in zip(panels, scenes, strict=True):
        for label, figures in rows.items():
            axes.plot(spps, [figures[f"{scene} {spp}"]["strict"] for spp in spps], marker="o", label=label)
        axes.axhline(ceiling[scene]["strict"], color="0.6", linestyle="--", label="ceiling")
        axes.set_xscale("log", base=2)
        axes.set_xticks(spps, [str(spp) for spp in spps])
        axes.set(title=scene, xlabel="samples a pixel, common random numbers")
        axes.grid(color="0.9")
    panels[0].set_ylabel("strict F1")
    panels[-1].legend(fontsize=8, loc="lower right")
    figure.savefig(path, dpi=110)


def cell(figures: Figures) -> str:
    """Return F1 and strict F1, without leading zeros."""
    return f"{figures['f1']:.3f} ({figures['strict']:.3f})".replace("0.", ".")


if __name__ == "__main__":
    main()
