"""The interest map: what flows back from the detector to the renderer."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass
from typing import Literal

from clsim.errors import Error, require_choice
from clsim.frames.frame import FloatArray

DELAY = 2
"""Frame k is rendered with the map of frame k − 2, so that rendering and detection overlap and runs are repeatable."""


@dataclass(slots=True)
class InterestMap:
    """How close each pixel is to firing, after a frame; NaN where a pixel has no reference.

    Attributes:
        number: how many frames the detector saw before this one.
        to_on: float32 ``[H, W]``, distance of L to the ON threshold [natural-log units].
        to_off: float32 ``[H, W]``, distance of L to the OFF threshold, likewise.
        change: float32 ``[H, W]``, change of L since the frame before [natural-log units].
        stderr: float32 ``[H, W]``, standard error of L [natural-log units], 0 where nobody knows it. It is that of one
            frame by itself, from how uneven the light around the pixel is: what persists from frame to frame counts in
            full, though it cancels in ``change`` and in both distances.
    """

    number: int
    to_on: FloatArray
    to_off: FloatArray
    change: FloatArray
    stderr: FloatArray


class InterestBoard:
    """Where a detector puts its maps and a renderer finds them."""

    def __init__(self, missing: Literal["refuse", "wait", "newest"] = "refuse") -> None:
        """Prepare an empty board.

        Args:
            missing: what `find` does while the map that it wants is not there: "refuse" raises an error, for renderer
                and detector in one thread; "wait" waits for a detector in another thread; "newest" takes the newest
                map there is, for where frames are dropped between both sides, so that numbers do not tell which is
                meant.
        """
        require_choice("missing", missing, ("refuse", "wait", "newest"))
        self._missing = missing
        self._maps: deque[InterestMap] = deque(maxlen=DELAY + 1)
        self._changed = threading.Condition()
        self._closed = False

    def publish(self, interest: InterestMap) -> None:
        """Put up a map; older ones are forgotten once no frame can need them."""
        with self._changed:
            self._maps.append(interest)
            self._changed.notify_all()

    def find(self, frame_number: int) -> InterestMap | None:
        """Return the map with which the renderer's frame ``frame_number`` is made; None for the first ones.

        Where the board waits, it is for the detector to get so far, or for `close`; then None.

        Raises:
            Error: the board refuses, and the map is not there.
        """
        wanted = frame_number - DELAY
        if wanted < 0:
            return None
        with self._changed:
            if self._missing == "newest":
                return self._maps[-1] if self._maps else None
            while True:
                for interest in self._maps:
                    if interest.number == wanted:
                        return interest
                if self._closed:
                    return None
                if self._missing == "refuse":
                    raise Error(
                        f"frame {frame_number} takes the interest map of frame {wanted}, expected it to be published "
                        "before; a board with `missing` wait waits for another thread to do so"
                    )
                self._changed.wait()

    def close(self) -> None:
        """Let nobody wait any longer; safe from any thread and to call twice."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
