"""What each event is of: its cause, the object at its pixel, and how fast that moves in the image."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from clsim.events import Causes, EventBatch
from clsim.frames import Frame, plane_of

LABEL_DTYPE = np.dtype([("object", "<u4"), ("flow", "<f4", (2,)), ("cause", "u1")])
"""Number of the object (0 is nothing), image velocity right and down [px/s], NaN where it is not known, and the cause,
an index of `clsim.events.CAUSES`."""


class Labeller:
    """Labels events by the frame that is nearer to each in time: that before its step, or that after.

    Both are of the pixel's centre: at a silhouette an event may come from the other side of the edge.
    """

    def __init__(self) -> None:
        """Know no frame yet."""
        self._last: tuple[int, npt.NDArray[np.float32]] | None = None

    def label(self, frame: Frame, events: EventBatch, causes: Causes | None = None) -> npt.NDArray[np.void]:
        """Return the labels of the events of the step that led to ``frame``, ``[n]`` of `LABEL_DTYPE`.

        Without ``causes`` brightness caused them all.
        """
        rows = [
            frame.names.index(name) for plane in ("Label.object", "Label.flow") for name in plane_of(plane).channels
        ]
        now = frame.time_us, frame.planes[rows]  # a copy
        before = now if self._last is None else self._last
        self._last = now
        labels = np.zeros(len(events), LABEL_DTYPE)
        labels["cause"] = 0 if causes is None else causes
        late = events["t"] - before[0] > now[0] - events["t"]
        for (_, planes), mine in ((before, ~late), (now, late)):
            x, y = events["x"][mine], events["y"][mine]
            number, right, down, valid = planes[:4, y, x]
            labels["object"][mine] = number
            known = np.where(valid > 0, 1.0, np.nan).astype(np.float32)
            labels["flow"][mine] = np.stack([right * known, down * known], axis=-1)
        return labels
