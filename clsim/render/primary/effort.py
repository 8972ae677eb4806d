"""The sample budget of pixels: how many paths and primary rays each gets in a frame, by interest maps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from clsim.errors import InputError
from clsim.frames import DELAY, InterestBoard, InterestMap
from clsim.render.primary.ray_numbers import PrimaryRays
from clsim.render.primary.steered import GRADES, REFINED, Steering

NEAR = 0.1
"""Where nobody knows an error, pixels within this share of the contrast threshold are near to an event."""
SURE = 2.0
"""Standard errors from a threshold at which a decision is safe: with normal errors, one in 44 is wrong."""
TIMELY = 0.25
"""Share of a step to which the time of an event is found, with that safety, where one is sure to fire."""
STILL = 0.05
"""Changes of a step below this share of the contrast threshold bring out that part of the standard error only."""
_INSIDE = 4
"""Primary rays after which a pixel may be found to show one surface, if its corners are not sampled; an eighth of all,
where that is more …"""
_INSIDE_PLAIN = ((16, 1), (64, 2), (1 << 30, 3))
"""… and if they are, pairs of a number and the rays inside below it: these find what is smaller than a pixel."""
_IN_SHADOW = 32
"""Primary rays up to which a part-lit pixel gets more than one of several surfaces. Twice as many take a fourth more
time where there are many soft shadows, and gain a hundredth there."""
_AT_CONTRAST = 16
"""Largest multiple of the primary rays where surfaces differ in brightness, with cached light."""
_ENOUGH_TO_REFINE = 12
"""Primary rays from which on there are more where that helps. Of fewer, a pixel that gets more shows another brightness
than before, by as much as an event."""
_AT_EVENT, _AT_EVENT_CACHED = 6, 8
"""Largest multiple of them where an event is near, the second with cached light, …"""
_MOST_COUNT = 1024
"""… and the most then."""
ENOUGH_FOR_EDGES = 8
"""Primary rays from which on corners are sampled, and edges placed."""
_AHEAD = DELAY + 0.5
"""Steps by which a change is drawn out, from the map's frame to half a step beyond the one that is rendered."""


@dataclass(frozen=True)
class Effort:
    """The largest and smallest sample numbers of a pixel of a frame.

    Attributes:
        spp: paths where the most are needed to tell whether, or when, an event fires.
        probe_spp: paths where fewest are, at most ``spp``; elsewhere twice, four times … as many. Common random
            numbers make them the first of ``spp``.
        first_hit_rays: primary rays where a pixel shows more than one surface. Where direct light is analytic, a
            part-lit pixel gets `rays_in_shadow`; of one that shows one triangle three in four are shadow rays
            alone, or all where nothing is smaller than a pixel.
        every: a pixel that needs no more is probed in every n-th frame, at another phase than its neighbours.
    """

    spp: int
    probe_spp: int
    first_hit_rays: int
    every: int = 1

    def __post_init__(self) -> None:
        """Refuse values that cannot work."""
        if not 1 <= self.probe_spp <= self.spp:
            raise InputError(f"`probe_spp` must be from 1 to `spp`, which is {self.spp}, got {self.probe_spp}")
        if self.first_hit_rays < 1:
            raise InputError(f"`first_hit_rays` must be at least 1 here, got {self.first_hit_rays}")
        if self.every < 1:
            raise InputError(f"`every` must be at least 1, got {self.every}")

    @property
    def top(self) -> int:
        """How often the probe is doubled to come to ``spp``, or beyond; at most so often that there are `GRADES`."""
        return min((-(-self.spp // self.probe_spp) - 1).bit_length(), GRADES - 1)


@dataclass(frozen=True)
class PrimarySetup:
    """What primary rays see of a scene, however many there are.

    Attributes:
        pixel: how wide a pixel is (`pixel_width.py`).
        sharp: whether the picture has no blur; else a pixel's corners do not tell what it shows.
        lamps: whether these rays also find shadows. Those at corners do too, so that fewer are wanted inside.
    """

    pixel: tuple[float, float]
    sharp: bool
    lamps: bool = False


def rays_in_shadow(first_hit_rays: int) -> int:
    """Return how many primary rays a part-lit pixel gets: a power of two, as Sobol's points are most even then."""
    most = max(min(2 * first_hit_rays, _IN_SHADOW), first_hit_rays // 2)
    return 1 << (most.bit_length() - 1)


def primary_rays_for(first_hit_rays: int, primary_setup: PrimarySetup, cached: bool = False) -> Any:
    """Return how many primary rays a pixel gets by what it shows.

    Args:
        first_hit_rays: largest number.
        primary_setup: what they see.
        cached: whether light is cached on surfaces.
    """
    primary_rays: Any = PrimaryRays()
    primary_rays.most, primary_rays.pixel = first_hit_rays, wp.vec2(*primary_setup.pixel)
    primary_rays.inside = min(max(_INSIDE, first_hit_rays // 8), first_hit_rays)
    if first_hit_rays >= _ENOUGH_TO_REFINE:
        primary_rays.at_contrast = min(_AT_CONTRAST * first_hit_rays, _MOST_COUNT) if cached else 0
        primary_rays.at_event = min((_AT_EVENT_CACHED if cached else _AT_EVENT) * first_hit_rays, _MOST_COUNT)
    primary_rays.in_shadow = rays_in_shadow(first_hit_rays)
    if primary_setup.sharp and first_hit_rays >= ENOUGH_FOR_EDGES:
        beside_corners = first_hit_rays // 4 if primary_setup.lamps else first_hit_rays
        primary_rays.inside = next(rays for fewer, rays in _INSIDE_PLAIN if beside_corners < fewer)
        primary_rays.by_edge = first_hit_rays // 3
        primary_rays.steps = (first_hit_rays - 1).bit_length()
        primary_rays.texels = 4 * first_hit_rays
    return primary_rays


def largest_around(values: Any, room: Any) -> Any:
    """Return the largest value of each pixel and its eight neighbours, uint8 ``[H, W]``.

    ``room`` to work in is uint8 ``[H + 2, W + 2]``, 0 in its border.
    """
    room[1:-1, 1:-1] = values
    rows = np.maximum(np.maximum(room[:-2], room[1:-1]), room[2:])
    return np.maximum(np.maximum(rows[:, :-2], rows[:, 1:-1]), rows[:, 2:])


class MapReader:
    """The base of sample allocators: reads interest maps from a board, and counts what frames took.

    Attributes:
        effort: what holds from the next frame on; may be set from any thread.
        first_hit_rays: primary rays traced so far.
        paths: paths traced so far.
    """

    def __init__(
        self,
        width: int,
        height: int,
        effort: Effort,
        primary_setup: PrimarySetup,
        board: InterestBoard | None,
        device: Any,
    ) -> None:
        """Begin before the first frame."""
        self.effort = effort
        self.first_hit_rays = self.paths = 0
        self.light_s = 0.0
        self._primary_setup, self._board = primary_setup, board
        self._number = 0
        self._index = -1
        self._restarts = True
        self._grades = np.zeros((height, width), dtype=np.uint8)
        self._padded = np.zeros((height + 2, width + 2), dtype=np.uint8)
        self._spent: Any = wp.zeros((2, width * height), dtype=wp.int32, device=device)

    def cancel(self) -> None:
        """Let `prepare` wait for no map any longer; safe from any thread."""
        if self._board is not None:
            self._board.close()

    def finish(self) -> bool:
        """Add up what the frame took; return whether it is to be rendered again, which it never is."""
        first_hit_rays, paths = self._spent.numpy().sum(axis=1, dtype=np.int64)
        self.first_hit_rays += int(first_hit_rays)
        self.paths += int(paths)
        return False


class Steerer(MapReader):
    """The sample allocator: decides from interest maps which pixels of a frame get how many samples."""

    def __init__(
        self,
        width: int,
        height: int,
        effort: Effort,
        primary_setup: PrimarySetup,
        board: InterestBoard | None,
        device: Any,
        *,
        refines: bool = True,
    ) -> None:
        """Allocate the state from frame to frame.

        Where it never ``refines``, a pixel is seen by as many rays in each frame, and between frames.
        """
        super().__init__(width, height, effort, primary_setup, board, device)
        pixels = width * height
        self._before = effort
        self._refines = refines
        self._refined, self._moves = np.zeros((2, height, width), dtype=np.bool_)
        self._device_grades: Any = wp.zeros(pixels, dtype=wp.uint8, device=device)
        self._irradiance: Any = wp.zeros(pixels, dtype=wp.vec3, device=device)
        self._correction: Any = wp.zeros((GRADES, pixels), dtype=wp.vec3, device=device)
        self._known: Any = wp.zeros(pixels, dtype=wp.int32, device=device)

    @property
    def arguments(self) -> dict[str, Any]:
        """Arguments of the kernel without the scene and the frame; ``steering`` changes with each frame."""
        return {
            "steering": Steering(),
            "grades": self._device_grades,
            "irradiance": self._irradiance,
            "correction": self._correction,
            "known": self._known,
            "out_spent": self._spent,
        }

    def prepare(self, index: int, time_us: int, pose: npt.NDArray[np.float64]) -> tuple[dict[str, Any], int]:
        """Choose the samples of the frame ``index``; return arguments of the kernel and the full number of paths.

        At which ``pose`` the camera is makes no difference here.

        Whenever it is, this takes the interest map of two frames ago, and waits for it where the board does.
        """
        effort = self.effort
        steering: Any = Steering()
        steering.primary_rays = primary_rays_for(effort.first_hit_rays, self._primary_setup)
        steering.every, steering.phase = effort.every, self._number
        steering.probe, steering.top = effort.probe_spp, effort.top
        # Where all get the same there is nothing to ask, and maybe nobody who answers.
        board = self._board if effort.probe_spp < effort.spp or effort.every > 1 else None
        if index <= self._index or self._restarts:
            # No earlier state tells of this frame.
            self._before = effort
            self._grades.fill(GRADES + 1)
            self._refined.fill(self._refines and board is not None)
            self._correction.zero_()
            self._known.zero_()
        else:
            interest = None if board is None else board.find(self._number)
            if interest is None:
                self._grades.fill(0)
            else:
                self._grade(interest, effort.top)
                if self._refines:
                    # What stands still goes on being seen by the same rays.
                    np.not_equal(interest.change, 0, out=self._moves)
                    np.greater(self._grades, 0, out=self._refined, where=self._moves)
        np.bitwise_or(self._grades, REFINED, out=self._grades, where=self._refined)
        wp.copy(self._device_grades, wp.array(self._grades.reshape(-1), dtype=wp.uint8, device="cpu", copy=False))
        before = self._before
        if (before.probe_spp, before.spp) != (effort.probe_spp, effort.spp):
            steering.before = before.probe_spp
        self._before, self._index, self._restarts = effort, index, False
        self._number += 1
        return {"steering": steering}, effort.spp

    def forget(self) -> None:
        """Trace all paths in the next frame, and keep nothing of earlier ones: the light is another one."""
        self._restarts = True
        self._irradiance.zero_()

    def _grade(self, interest: InterestMap, top: int) -> None:
        """Choose by how many doublings of the probe a decision is safe, or an event is timed; add 1 near an event.

        Twice the samples halve the variance. Neighbours get half as many, theirs a quarter: as they are smoothed, their
        noise is the pixel's too. Where nobody knows an error, the zone decides between the probe and all.
        """
        rise = _AHEAD * interest.change
        on, off = interest.to_on - np.maximum(rise, 0), interest.to_off + np.minimum(rise, 0)
        distance, change = np.maximum(np.minimum(on, off), 0), np.abs(interest.change)
        threshold = 0.5 * (interest.to_on + interest.to_off)
        # With common random numbers an error stays the same where nothing changes, and cancels.
        error = SURE * interest.stderr * np.minimum(1, change / (STILL * threshold))
        needed = np.square(error)
        enough = np.square(np.maximum(distance, TIMELY * change))
        grades = self._grades
        grades.fill(0)
        for _ in range(top):
            grades += needed > enough
            enough *= 2
        for _ in range(2):
            around = largest_around(grades, self._padded)
            np.maximum(grades, around - (around > 0), out=grades)
        # A pixel without a reference is near, whatever NaN compares to.
        near = ~(distance > NEAR * threshold)
        np.maximum(grades, top * largest_around(near & ~(interest.stderr > 0), self._padded), out=grades)
        grades += np.maximum(grades > 0, largest_around(near, self._padded))
