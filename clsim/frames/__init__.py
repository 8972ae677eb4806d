"""Frames: the data that flows from a renderer to a detector, and the ring between them."""

from clsim.frames.frame import FloatArray, Frame, frame_time_us, page_aligned
from clsim.frames.interest import DELAY, InterestBoard, InterestMap
from clsim.frames.planes import (
    ALBEDO,
    ALL_PLANES,
    BASE_PLANES,
    COVERAGE,
    DEPTH,
    EMISSION,
    LUMINANCE_VARIANCE,
    NORMAL,
    PLANES,
    RADIANCE,
    SAMPLES,
    TRUTH_PLANES,
    VARIANCE_PLANES,
    Plane,
    PlaneSet,
    plane_of,
    rendered_planes,
)
from clsim.frames.protocols import Cancellable, CountsRays, FrameSource, Renoising
from clsim.frames.ring import FrameRing, Policy, RingClosed

__all__ = [
    "ALBEDO",
    "ALL_PLANES",
    "BASE_PLANES",
    "COVERAGE",
    "DELAY",
    "DEPTH",
    "EMISSION",
    "LUMINANCE_VARIANCE",
    "NORMAL",
    "PLANES",
    "RADIANCE",
    "SAMPLES",
    "TRUTH_PLANES",
    "VARIANCE_PLANES",
    "Cancellable",
    "CountsRays",
    "FloatArray",
    "Frame",
    "FrameRing",
    "FrameSource",
    "InterestBoard",
    "InterestMap",
    "Plane",
    "PlaneSet",
    "Policy",
    "Renoising",
    "RingClosed",
    "frame_time_us",
    "page_aligned",
    "plane_of",
    "rendered_planes",
]
