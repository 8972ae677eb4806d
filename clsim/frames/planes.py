"""The table of planes: what a frame may hold, in which order, and what each plane means.

The order of a frame's planes, the channel names of our EXR files and docs/planes.md come from this table. Names extend
the layout of the ICIP 2023 program (R, G, B, Albedo.*, Nx, Ny, Nz, Depth, Variance.*), so it can read ours.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

Reduction = Literal["mean", "mean over hits", "sum", "centre ray"]
"""How a pixel's samples become its value; "mean over hits" leaves out samples that hit nothing, 0 where all did.

A "centre ray" is no sample: it goes through the middle of the pixel at the frame's very time."""
Given = Literal["always", "first-hit rays", "variance only", "truth"]
"""Which rendered frames have a plane.

All, those whose first hits are sampled apart, none but for its variance, or those for which it was asked as truth."""

_RADIANCE_UNIT = "W·sr⁻¹·m⁻²"


@dataclass(frozen=True)
class Plane:
    """One row of the table: a quantity of a pixel.

    Attributes:
        name: what the quantity is called.
        channels: names of its channels, in order; also those of EXR files.
        unit: the unit of each channel, "1" for a plain number.
        meaning: what it is, in a sentence without a full stop.
        reduction: how a pixel's samples become its value.
        variance: whether the variance of that value may be had, as one more channel for each channel.
        given: which rendered frames have it.
    """

    name: str
    channels: tuple[str, ...]
    unit: str
    meaning: str
    reduction: Reduction
    variance: bool
    given: Given = "always"

    @property
    def width(self) -> int:
        """Number of channels."""
        return len(self.channels)

    @property
    def variance_channels(self) -> tuple[str, ...]:
        """Names of the channels of the variance of its value; none where there is no variance."""
        return tuple(f"Variance.{channel}" for channel in self.channels) if self.variance else ()


def _truth(name: str, channels: tuple[str, ...], unit: str, meaning: str) -> Plane:
    return Plane(name, channels, unit, meaning, "centre ray", False, "truth")


def _flow_channels(way: str) -> tuple[str, ...]:
    return tuple(f"Flow.{way}.{channel}" for channel in ("X", "Y", "valid", "covisible"))


_FLOW = (
    "displacement of the point at the pixel's centre from this frame to the {0} frame of truth, in pixels right and "
    "down; valid is 1 where it is known, covisible 1 where the point is in the picture and visible in the {0} frame too"
)

PLANES = (
    Plane("Radiance", ("R", "G", "B"), _RADIANCE_UNIT, "linear Rec. 709 radiance", "mean", True),
    Plane(
        "Albedo",
        ("Albedo.R", "Albedo.G", "Albedo.B"),
        "1",
        "share of light that the seen surface reflects, times the tint of mirrors and glass on the way",
        "mean over hits",
        True,
    ),
    Plane(
        "Normal",
        ("Nx", "Ny", "Nz"),
        "1",
        "shading normal of the seen surface along the world's axes, facing the ray; means over several surfaces are "
        "shorter than 1",
        "mean over hits",
        True,
    ),
    Plane(
        "Depth",
        ("Depth",),
        "m",
        "distance along the ray to the seen surface, by way of mirrors and glass",
        "mean over hits",
        True,
    ),
    Plane("Coverage", ("Coverage",), "1", "share of the samples that hit something, 0…1", "mean", True),
    Plane("Samples", ("Samples",), "1", "number of samples that the pixel got", "sum", False),
    Plane(
        "Emission",
        ("Emission",),
        _RADIANCE_UNIT,
        "luminance of lamps and sky that the pixel sees, directly or in mirrors; a part of R, G and B",
        "mean",
        False,
        "first-hit rays",
    ),
    Plane(
        "Luminance",
        ("Luminance",),
        _RADIANCE_UNIT,
        "luminance of R, G and B: Rec. 709's, or the sensor's weights",
        "mean",
        True,
        "variance only",
    ),
    _truth("Z", ("Z",), "m", "distance along the camera's axis to what the pixel's centre shows; inf where nothing is"),
    _truth("Truth.Depth", ("Truth.Depth",), "m", "distance along the ray to the surface; inf where nothing is"),
    _truth(
        "Truth.Normal",
        ("Truth.Nx", "Truth.Ny", "Truth.Nz"),
        "1",
        "shading normal of the surface along the world's axes, facing the ray; 0 where nothing is",
    ),
    _truth(
        "Truth.Albedo",
        ("Truth.Albedo.R", "Truth.Albedo.G", "Truth.Albedo.B"),
        "1",
        "share of light that the surface reflects; 0 where nothing is",
    ),
    _truth("Id.object", ("Id.object",), "1", "number of the object, from 1; 0 where nothing is"),
    _truth(
        "Id.material",
        ("Id.material",),
        "1",
        "number of the surface's material, from 1; 0 for a sphere light, or where nothing is",
    ),
    _truth("Flow.forward", _flow_channels("forward"), "px, px, 1, 1", _FLOW.format("next")),
    _truth("Flow.backward", _flow_channels("backward"), "px, px, 1, 1", _FLOW.format("previous")),
    _truth("Label.object", ("Label.object",), "1", "number of the object; also in frames without other truth"),
    _truth(
        "Label.flow",
        tuple(f"Label.flow.{channel}" for channel in ("X", "Y", "valid", "covisible")),
        "px/s, px/s, 1, 1",
        "mean velocity of the point at the pixel's centre until the next rendered frame; in all frames too",
    ),
)
"""All planes, in the order in which frames have them."""

TRUTH_PLANES: dict[str, tuple[str, ...]] = {
    "depth": ("Z",),
    "distance": ("Truth.Depth",),
    "normal": ("Truth.Normal",),
    "albedo": ("Truth.Albedo",),
    "ids": ("Id.object", "Id.material"),
    "flow": ("Flow.forward",),
    "backward-flow": ("Flow.backward",),
    "labels": ("Label.object", "Label.flow"),
}
"""The planes of truth by the names under which they are asked for."""


def plane_of(name: str) -> Plane:
    """Return the row called ``name``; KeyError if there is none."""
    for plane in PLANES:
        if plane.name == name:
            return plane
    raise KeyError(f"no plane is called {name!r}; there are {', '.join(plane.name for plane in PLANES)}")


@dataclass(frozen=True)
class PlaneSet:
    """The planes of a rendered frame and where each lies: values, then variances, then truth, in the table's order.

    Attributes:
        planes: the planes whose values are there.
        with_variance: the planes whose variances are there.
        truth: the planes of truth.
    """

    planes: tuple[Plane, ...]
    with_variance: tuple[Plane, ...] = ()
    truth: tuple[Plane, ...] = ()

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The name of each channel, as in `Frame.names`."""
        values = [channel for plane in self.planes for channel in plane.channels]
        variances = [channel for plane in self.with_variance for channel in plane.variance_channels]
        return (*values, *variances, *(channel for plane in self.truth for channel in plane.channels))

    def first(self, name: str) -> int:
        """Return the index of the first channel of the plane called ``name``; KeyError if the set lacks it."""
        return self._index(plane_of(name).channels[0])

    def first_variance(self, name: str) -> int:
        """Return the index of the first channel of that plane's variance; KeyError if the set lacks it."""
        plane = plane_of(name)
        if plane not in self.with_variance:
            raise KeyError(f"the variance of {name!r} is not among {', '.join(self.names)}")
        return self._index(plane.variance_channels[0])

    def _index(self, channel: str) -> int:
        if channel not in self.names:
            raise KeyError(f"the channel {channel!r} is not among {', '.join(self.names)}")
        return self.names.index(channel)


def rendered_planes(*, first_hit_rays: bool = False, variances: bool = False, truth: Collection[str] = ()) -> PlaneSet:
    """Return the planes of frames as the path tracer renders them.

    ``first_hit_rays``: first hits are sampled apart; ``variances``: so far as planes have one, their variances too;
    ``truth``: what is asked for of `TRUTH_PLANES`.
    """
    wanted = ("always", "first-hit rays") if first_hit_rays else ("always",)
    values = tuple(plane for plane in PLANES if plane.given in wanted)
    asked = {name for each in truth for name in TRUTH_PLANES[each]}
    return PlaneSet(
        values,
        tuple(plane for plane in PLANES if plane.variance) if variances else (),
        tuple(plane for plane in PLANES if plane.name in asked),
    )


RADIANCE = plane_of("Radiance").channels
ALBEDO = plane_of("Albedo").channels
NORMAL = plane_of("Normal").channels
DEPTH = plane_of("Depth").channels
COVERAGE = plane_of("Coverage").channels
SAMPLES = plane_of("Samples").channels
EMISSION = plane_of("Emission").channels
LUMINANCE_VARIANCE = plane_of("Luminance").variance_channels[0]
"""R, G and B covary: the variance of luminance cannot be had from theirs."""

BASE_PLANES = rendered_planes().names
ALL_PLANES = rendered_planes(variances=True).names
VARIANCE_PLANES = ALL_PLANES[len(BASE_PLANES) :]
"""Variances of the pixel's value, not of one sample; NaN where fewer than two samples tell."""
