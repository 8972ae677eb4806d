"""The summary of a run."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Summary:
    """What a run did so far; the fields are the keys of ``clsim live --json``.

    Attributes:
        name: what is shown: a scene, or a folder of frames.
        width, height: of the sensor [pixels].
        frames: frames detected.
        events, on_events: events written, and how many of them are ON.
        solved_share: share of the tested pixels whose regression was solved; None for methods without one.
        masked_pixels: pixels left out because of NaN or infinite values, summed over frames.
        steep_pixels: pixels that crossed more than 3 thresholds in one step, summed over steps.
        most_crossings: the largest number of thresholds that a pixel crossed in one step.
        capped_events: events not written because a pixel had too many in one step.
        noise_share: share of the events that is likely noise of the rendering (`clsim.live.noise.duplicate_sampling`);
            None where that is not measured.
        ideal_noise_share: the same of what ideal pixels would fire in place of a real sensor; None where it is ideal.
        lost_events: events that the sensor's readout had no time for.
        dropped_frames, late_frames: frames lost, and frames begun more than a frame's time late, at real pace.
        paths, first_hit_rays: light paths and first-hit rays traced; None where frames were recorded.
        light_s: time that was spent on updating cached light, between frames; None where frames were recorded.
        effort: samples in force: ``probe_spp``, ``spp``, ``first_hit_rays``, ``every``; None for recorded frames.
        governor: what it decided; None without one.
        simulated_s: time from the first frame to the last.
        wall_s, cpu_s: time since the run was opened, and processor time of all threads and of processes begun.
        startup_s: time from the start to the first frame's events; None before.
        frames_per_s: frames a second since then.
        motion: how far the picture moves from frame to frame (see `clsim.footage.displacement.Displacement`): pairs of
            frames that were measured, of which ``fast_pairs`` by more than a pixel, ``lost_pairs`` in which nothing was
            found again, and ``largest_px``; None but for video and pictures.
        chosen: what was chosen and why, a sentence each.
        too_dark: a sentence, where half of the first picture is too dark for the sensor; else None.
        no_events: a sentence on why there are none, as far as it is known and nothing else tells of it; else None.
        outputs: for each output its ``name``, its ``error`` if it failed, and figures of its own.
    """

    name: str
    width: int
    height: int
    frames: int
    events: int
    on_events: int
    solved_share: float | None
    masked_pixels: int
    steep_pixels: int
    most_crossings: int
    capped_events: int
    noise_share: float | None
    ideal_noise_share: float | None
    lost_events: int
    dropped_frames: int
    late_frames: int
    paths: int | None
    first_hit_rays: int | None
    light_s: float | None
    effort: dict[str, int] | None
    governor: dict[str, Any] | None
    simulated_s: float
    wall_s: float
    cpu_s: float
    startup_s: float | None
    frames_per_s: float
    motion: dict[str, float] | None
    chosen: tuple[str, ...]
    too_dark: str | None
    no_events: str | None
    outputs: list[dict[str, Any]]

    def as_dict(self) -> dict[str, Any]:
        """Return all values by name."""
        return asdict(self)
