"""Messages of the library, with its fields as the command line spells them."""

from __future__ import annotations

import re

_OPTIONS = {
    "duration_s": "--duration",
    "outputs": "--out",
    "threshold_off": "--threshold",
    "threshold_on": "--threshold",
    "time_tolerance_us": "--time-tolerance",
}
"""Options whose name is not that of the field with hyphens."""
CONFIG_KEYS = frozenset(
    (
        "camera_axes", "camera_interpolation", "first_hit_rays", "follow_specular", "governor", "imu_noise",
        "imu_rate", "pose_rate", "probe_every", "probe_spp", "ring", "sampler",
    )
)  # fmt: skip
"""Fields of a run that are no options: they stand in a file for ``--config``."""


def as_options(message: str) -> str:
    """Return a message with each field that stands between backticks, such as `max_depth`, spelled ``--max-depth``."""
    return re.sub("`([a-z_0-9]+)`", _as_option, message)


def _as_option(found: re.Match[str]) -> str:
    if found[1] in CONFIG_KEYS:
        return found[0]
    return _OPTIONS.get(found[1], f"--{found[1].replace('_', '-')}")
