"""What other converters of video take for brightness, so that their results can be compared.

Neither undoes the video's transfer function: their brightness is a function of the stored values.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from clsim.footage import Convention, Transfer


@dataclass(frozen=True)
class Settings:
    """What stands for the options that are not given.

    Attributes:
        transfer: which transfer function is undone; None takes the file's.
        offset: what is added to light.
        detector: options of the detector by name.
    """

    transfer: Transfer | None = None
    offset: float = 0.0
    detector: dict[str, Any] = field(default_factory=dict)


PLAIN = Settings(detector={"method": "esim"})
"""Footage has no noise of rendering, and nothing that a regression could use."""
CONVENTIONS: dict[Convention, Settings] = {
    # Hu, Liu and Delbruck, "v2e: From Video Frames to Realistic DVS Events", 2021: lin-log of luma 0…255, linear to 20.
    "v2e": Settings("as-is", detector={"method": "esim", "response": "lin-log", "luminance": "rec601"}),
    # metavision_core_ml.video_to_event: ln(1e-7 + luma / 255), in its configuration "clean".
    "openeb": Settings("as-is", 1e-7, {"method": "esim", "luminance": "rec601", "floor": 1e-8}),
}
"""Thresholds are 0.2 in all of them, and noise is left out."""
CONVENTIONAL = frozenset(("floor", *(name for settings in CONVENTIONS.values() for name in settings.detector)))
"""Options of the detector that a convention chooses; the floor follows from what is taken for light."""
