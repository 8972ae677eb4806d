"""The small interfaces where rooms meet, so that each part can be replaced."""

from __future__ import annotations

from typing import Protocol

from clsim.frames.frame import Frame


class FrameSource(Protocol):
    """Anything that fills frames: the path tracer, an EXR sequence, a test."""

    width: int
    height: int
    names: tuple[str, ...]
    """Planes that every frame of the source has."""
    frame_count: int | None
    """Number of frames, None when endless."""

    def fill(self, index: int, out: Frame) -> None:
        """Write frame ``index`` into ``out``, time and index included. Raises InputError on unusable input."""
        ...

    def close(self) -> None:
        """Release what the source holds; safe to call twice."""
        ...
