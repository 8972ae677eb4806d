"""The small interfaces where rooms meet, so that each part can be replaced."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from clsim.errors import Error
from clsim.frames.frame import FloatArray, Frame


class SourceEnded(Error):  # noqa: N818 - a normal end, not an error
    """There is no frame of this number, nor will there be: the sequence has ended."""


class FrameSource(Protocol):
    """Anything that fills frames: the path tracer, an EXR sequence, a test."""

    width: int
    height: int
    names: tuple[str, ...]
    """Planes that every frame of the source has."""
    frame_count: int | None
    """Number of frames, None when endless."""

    def fill(self, index: int, out: Frame) -> None:
        """Write frame ``index`` into ``out``, time and index included.

        Raises:
            InputError: the input cannot be used.
            SourceEnded: there are fewer frames; only from sources without a ``frame_count``.
        """
        ...

    def close(self) -> None:
        """Release what the source holds; safe to call twice."""
        ...


@dataclass(frozen=True)
class Reflected:
    """What pixels reflect at times of their own, in a step; between two of a pixel it is straight in time.

    Attributes:
        known: y·width + x of those of which something is known, rising.
        pixels: those whose albedo changes, rising, ``[P]``; that of others stays as it is.
        firsts: the i-th pixel has the rows ``firsts[i]`` to ``firsts[i + 1] - 1``, ``[P + 1]``.
        shares: of the step that have passed, from 0 to 1 in each pixel, ``[K]``.
        values: sums over R, G and B of albedo times light, ``[K]``.
    """

    known: npt.NDArray[np.int64]
    pixels: npt.NDArray[np.int64]
    firsts: npt.NDArray[np.int64]
    shares: FloatArray
    values: FloatArray


@dataclass(frozen=True)
class Fineness:
    """How far what is reflected may leave the lines between the times at which it is told.

    Attributes:
        least: share of it that will do.
        late: share of the step within which it comes to what it should be, which will do as well.
        longest: log of the ratio of two values at most, between which it is not looked at.
        finest: times are no nearer to each other than this share of the step.
        linear: whether it is linear in time on a line; else its logarithm is.
    """

    least: float
    late: float
    longest: float
    finest: float
    linear: bool


class PixelTracer(Protocol):
    """What traces chosen pixels at chosen times, as in the frames of those times."""

    names: tuple[str, ...]
    """Planes of what it traces."""
    lit: bool
    """Whether radiance is all of a pixel's; else it is what is emitted, and the light on what is seen is unknown."""

    def trace(self, pixels: npt.NDArray[np.int32], times_s: npt.NDArray[np.float64]) -> FloatArray:
        """Return the planes ``[C, N]`` of N pixels, y·width + x each, at N times [s]."""
        ...

    def motion(self, start_s: float, end_s: float) -> FloatArray | None:
        """Return how far things go on the image from one time to another, ``[3, 2, H, W]`` [pixels right and down].

        Of what a pixel sees at the start, of what it sees at the end, and the longest way over it. None where
        nothing moves.
        """
        ...

    def bounds(self) -> npt.NDArray[np.bool_] | None:
        """Return where more is seen in the last frame than one flat surface whose albedo its texture tells, ``[H, W]``.

        None where that is not known, or things move by themselves.
        """
        ...

    def steady_shadows(self) -> npt.NDArray[np.bool_]:
        """Return which pixels, ``[H·W]``, show one triangle that the same rays found lit in the last two frames.

        So their light is a line in time, also in soft shadows. It is known where `bounds` is.
        """
        ...

    def reflected(
        self, pixels: npt.NDArray[np.int64], light: FloatArray, start_s: float, end_s: float, fineness: Fineness
    ) -> Reflected:
        """Return what some pixels reflect from one time to that of the last frame, ``end_s``; see `bounds`.

        They show one flat surface meanwhile. ``light``, ``[6, H·W]``, is that of all pixels at both times, R, G and B.
        """
        ...

    def cancel(self) -> None:
        """Make a running ``trace``, and every later one, raise an error soon; safe from any thread."""
        ...

    def close(self) -> None:
        """Release what it holds; safe to call twice."""
        ...


@runtime_checkable
class Cancellable(Protocol):
    """A source whose ``fill`` can be cut short."""

    def cancel(self) -> None:
        """Make a running ``fill``, and every later one, raise an error soon; safe from any thread."""
        ...


@runtime_checkable
class CountsRays(Protocol):
    """A source that tells what it has traced so far."""

    paths: int
    first_hit_rays: int
    light_s: float


@runtime_checkable
class Renoising(Protocol):
    """A source that can show a frame again with other noise."""

    noise_offset: int
    """Added to a frame's index where each frame has random numbers of its own; holds from the next frame on."""
