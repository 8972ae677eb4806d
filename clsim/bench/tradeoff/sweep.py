"""Speed against accuracy: sweep renderings and detectors, score each against a clean reference, count its cost."""

from __future__ import annotations

import dataclasses
import platform
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from clsim.bench.tradeoff.content_key import FRAME_ROOMS, code_key, content_key, world_key
from clsim.bench.tradeoff.convergence import Convergence, converge
from clsim.bench.tradeoff.measure import run_point, start_up, warm_renderer
from clsim.bench.tradeoff.mismatch import mismatch_scale
from clsim.bench.tradeoff.point_store import PointStore
from clsim.bench.tradeoff.reference_cache import RULES, Reference, is_kept, load_or_render
from clsim.bench.tradeoff.settings import Point, Rendering, full_points, quick_points
from clsim.bench.tradeoff.stopwatch import Stopwatch
from clsim.bench.tradeoff.summary import summarise
from clsim.detect.config import EventRule
from clsim.errors import InputError
from clsim.events import EventBatch
from clsim.opencl.device import Device, choose_device
from clsim.render import RenderOptions
from clsim.render.device.devices import usable_cores
from clsim.scene import World, load_world
from clsim.score import PAPER_TAU, Score, score

SCHEMA = 3
REFERENCE_SEED = 0x5EED_0001
CEILING_SEED = 0x5EED_0002
WITHIN_US = 1000
FULL_BUDGET_S = 600.0
"""Processor time for the reference of a full sweep; a quick one takes the coarsest."""
_POINT_ROOMS = (*FRAME_ROOMS, "score", "bench")
_DETECTION_PATHS = 4
"""A detector's pass over a pixel is taken for so many paths, where time left is estimated."""

Report = Callable[[str, float, float], None]
"""Told what is being done, how much work is done, and how much there is in all [paths]."""


@dataclass(frozen=True)
class TradeoffOptions:
    """Options of a sweep; None takes the sweep's own value, for ``fps`` the scene's."""

    scene: str | Path
    cache: Path
    quick: bool = False
    reference_spp: int | None = None
    reference_budget_s: float | None = None
    resolution: tuple[int, int] | None = None
    frames: int | None = None
    fps: float | None = None
    seeds: tuple[int, ...] = (0,)
    points: tuple[Point, ...] = field(default=())
    """The points to measure; none are those of the full sweep, or of the quick one."""

    def __post_init__(self) -> None:
        """Refuse values that cannot work; each message names the option as the command line spells it."""
        if self.fps is not None and not 0 < self.fps < float("inf"):
            raise InputError(f"`fps` must be a positive number, got {self.fps}")
        if self.frames is not None and self.frames < 2:
            raise InputError(f"`frames` must be at least 2, for the first one fires nothing, got {self.frames}")
        if self.reference_spp is not None and self.reference_spp < 1:
            raise InputError(f"`reference_spp` must be at least 1, got {self.reference_spp}")
        if self.reference_budget_s is not None and not self.reference_budget_s >= 0:
            raise InputError(f"`reference_budget` must not be negative, got {self.reference_budget_s}")
        taken = {REFERENCE_SEED, CEILING_SEED}
        if not self.seeds or len(set(self.seeds)) < len(self.seeds) or any(s < 0 or s in taken for s in self.seeds):
            raise InputError(
                f"`seeds` must be different numbers, not negative and not {REFERENCE_SEED} or {CEILING_SEED} (the "
                f"reference's and the ceiling's), got {','.join(map(str, self.seeds)) or 'none'}"
            )
        if self.quick and len(self.seeds) > 1:
            raise InputError(f"`quick` measures one seed, got {','.join(map(str, self.seeds))}")


def run_tradeoff(options: TradeoffOptions, report: Report) -> dict[str, Any]:
    """Measure all points that were not measured before, and return the results; see docs/reference/tradeoff-results.md.

    Raises:
        InputError: the scene cannot be used, there is no OpenCL device, or nothing happens in the reference.
    """
    return Sweep(options, report).run()


class Sweep:
    """One sweep over one world: what it shares, what is missing, and how that is measured."""

    def __init__(self, options: TradeoffOptions, report: Report) -> None:
        """Load the world and the figures measured before."""
        quick = options.quick
        self.loading = Stopwatch()
        with self.loading:
            self.world: World = load_world(
                options.scene, resolution=options.resolution or ((64, 48) if quick else (128, 96))
            )
        self.starts: dict[Any, Stopwatch] = {}
        self.frames = options.frames or (24 if quick else 48)
        self.fps = options.fps or self.world.fps
        self.device: Device = choose_device()
        self.cache = options.cache
        chosen = quick_points(options.seeds[0]) if quick else full_points(options.seeds)
        self.points = list(options.points) or chosen
        spp = options.reference_spp or (1024 if quick else 4096)
        self.reference_options = Rendering(spp, "common", REFERENCE_SEED, "sobol").options(self.fps, self.frames)
        budget_s = options.reference_budget_s
        self.budget_s = (0.0 if quick else FULL_BUDGET_S) if budget_s is None else budget_s
        self.machine = machine(self.device)
        self.store = self.point_store()
        self.report = report
        self.done = self.total = 0.0

    def point_store(self) -> PointStore:
        """Return the store of points that were scored against the reference, by all else that points share."""
        shared = (self.frames, self.fps, dataclasses.asdict(self.reference_options), PAPER_TAU)
        key = content_key("points", world_key(self.world), shared, self.machine, code_key(_POINT_ROOMS))
        return PointStore(self.cache / f"points-{key}.jsonl")

    def run(self) -> dict[str, Any]:
        """Find the reference, measure what is missing and return all results."""
        coarsest = self.reference_options
        pair = (coarsest, dataclasses.replace(coarsest, seed=CEILING_SEED))
        absent = sum(not is_kept(self.world, options, self.cache) for options in pair)
        self.total = self.work(self.missing()) + absent * self.paths(coarsest)
        self.tell("loading kernels")
        if self.total:
            warm_renderer(self.world, dataclasses.replace(coarsest, spp=1))
        found = converge(self.reference, self.within, coarsest, CEILING_SEED, self.budget_s)
        self.reference_options = found.options
        self.store = self.point_store()
        missing = self.missing()
        self.total = self.done + self.work(missing)
        for point in missing:
            self.measure(point, found.reference)
        return self.results(found)

    def missing(self) -> list[Point]:
        """Return the points that are not in the store."""
        return [point for point in self.points if content_key(point.as_dict()) not in self.store]

    def work(self, points: list[Point]) -> float:
        """Estimate the work of measuring points, in paths."""
        pixels = self.world.camera.width * self.world.camera.height * self.frames
        return float(pixels * sum(point.rendering.spp + _DETECTION_PATHS for point in points))

    def paths(self, options: RenderOptions) -> float:
        """Return how many paths a reference takes."""
        return float(self.world.camera.width * self.world.camera.height * (options.frames or 0) * options.spp)

    def within(self, events: Reference, reference: Reference) -> float:
        """Return the F1 within 1 ms of a reference's events against another's."""
        return self.score(events.events["interpolated"], reference, "interpolated").within[WITHIN_US].f1

    def tell(self, what: str, samples: float = 0.0) -> None:
        """Report progress, after so many samples of each pixel of one frame."""
        self.done += samples * self.world.camera.width * self.world.camera.height
        self.report(what, self.done, self.total)

    def reference(self, options: RenderOptions, name: str) -> Reference:
        """Return clean events, rendered unless they are kept; ``name`` is what the report calls them."""
        what = f"{name}, {options.spp} spp, {options.fps:g} fps"
        if not is_kept(self.world, options, self.cache):
            self.total = max(self.total, self.done + self.paths(options))
        found = load_or_render(self.world, options, self.device, self.cache, lambda: self.tell(what, options.spp))
        if not all(len(events) for events in found.events.values()):
            raise InputError(
                f"no event fires in {self.frames} frames of {self.world.name}: there is nothing to score; "
                "expected more `frames` or a lower `fps`"
            )
        return found

    def render_options(self, point: Point) -> RenderOptions:
        """Return how a point's frames are rendered."""
        return point.options(self.fps, self.frames, self.world.sensor)

    def start(self, point: Point) -> None:
        """Load the kernels that a point needs, unless they are: it is no part of its cost."""
        options, config = self.render_options(point), point.detector.config(self.world.sensor)
        rendering, detecting = self.start_keys(point)
        if rendering not in self.starts or detecting not in self.starts:
            self.tell("loading kernels")
            for key, watch in zip(
                self.start_keys(point), start_up(self.world, options, config, self.device), strict=True
            ):
                self.starts.setdefault(key, watch)

    def start_keys(self, point: Point) -> tuple[Any, Any]:
        """Return what the kernels of rendering, and those of detection, depend on."""
        features = self.render_options(point).features_of(self.world)
        return features, (point.detector, features.first_hits)

    def measure(self, point: Point, reference: Reference) -> None:
        """Render and detect, score the events and store the figures."""
        self.start(point)
        options, config = self.render_options(point), point.detector.config(self.world.sensor)
        on_frame = partial(self.tell, point.label, point.rendering.spp + _DETECTION_PATHS)
        done = run_point(self.world, options, config, self.device, on_frame)
        starting = [self.loading, *(self.starts[key] for key in self.start_keys(point))]
        costs = {
            "paths": done.paths,
            "first_hit_rays_traced": done.first_hit_rays,
            "solved_share": done.solved_share,
            "render_cpu_s": done.rendering.cpu_s,
            "render_wall_s": done.rendering.wall_s,
            "detect_cpu_s": done.detecting.cpu_s,
            "detect_wall_s": done.detecting.wall_s,
            "peak_bytes": done.peak_bytes,
            "startup_cpu_s": sum(each.cpu_s for each in starting),
            "startup_wall_s": sum(each.wall_s for each in starting),
        }
        scored = self.score(done.events, reference, point.detector.event_rule)
        self.store.append(content_key(point.as_dict()), figures(scored, costs))

    def score(self, events: EventBatch, reference: Reference, rule: EventRule) -> Score:
        """Score events against the reference of an event rule."""
        camera = self.world.camera
        return score(events, reference.events[rule], camera.width, camera.height, self.fps, within_us=(WITHIN_US,))

    def results(self, found: Convergence) -> dict[str, Any]:
        """Return all points, their means, and what they were measured against."""
        from clsim import __version__

        reference, ceiling = found.reference, found.ceiling
        camera, sensor = self.world.camera, self.world.sensor
        points = [point.as_dict() | self.store[content_key(point.as_dict())] for point in self.points]
        scores = {rule: _scores(self.score(ceiling.events[rule], reference, rule)) for rule in RULES}
        settings = summarise(points)
        mismatch = mismatch_scale(reference.levels, sensor, self.fps, WITHIN_US)
        pixel_seconds = camera.width * camera.height * self.frames / self.fps
        for each in (*points, *settings):
            timed = each["event_rule"] != "frame"
            each["equivalent_mismatch"] = mismatch.equivalent(each["f1_within_1ms"]) if timed else None
            each["cpu_us_per_pixel_second"] = 1e6 * each["cpu_s"] / pixel_seconds
        return {
            "schema": SCHEMA,
            "clsim_version": __version__,
            "scene": self.world.name,
            "width": camera.width,
            "height": camera.height,
            "frames": self.frames,
            "fps": self.fps,
            "threshold_on": sensor.threshold_on,
            "threshold_off": sensor.threshold_off,
            "tau": PAPER_TAU,
            "machine": self.machine,
            "reference": {
                "spp": found.options.spp,
                "fps": found.options.fps,
                "converged": found.converged,
                "f1_within_1ms_moved": found.moved,
                "budget_s": self.budget_s,
                "spent_s": found.spent_s,
                "seed": REFERENCE_SEED,
                "ceiling_seed": CEILING_SEED,
                "events": {rule: len(reference.events[rule]) for rule in RULES},
                "cpu_s": reference.cpu_s,
                "wall_s": reference.wall_s,
            },
            "ceiling": scores,
            "mismatch_scale": {"spread": list(mismatch.spread), "f1_within_1ms": list(mismatch.f1)},
            "points": points,
            "settings": settings,
        }


def figures(scored: Score, costs: dict[str, Any]) -> dict[str, Any]:
    """Return scores and costs with the sums that both kinds of points have."""
    cpu_s = costs["render_cpu_s"] + costs["detect_cpu_s"]
    true_events = round(scored.strict_precision * scored.events)
    sums = {
        "cpu_s": cpu_s,
        "wall_s": costs["render_wall_s"] + costs["detect_wall_s"],
        "true_events": true_events,
    }
    return _scores(scored) | costs | sums


def _scores(scored: Score) -> dict[str, Any]:
    """Return all scores as plain numbers."""
    named = scored.as_dict()
    (within,) = named.pop("within").values()
    return named | {"f1_within_1ms": within["f1"]}


def machine(device: Device) -> dict[str, Any]:
    """Return what times depend on: processor, cores that this process may use, OpenCL device."""
    return {"processor": _processor(), "cores": usable_cores(), "opencl": device.name, "rendering": "cpu"}


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()
