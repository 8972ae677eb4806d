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


def as_options(message: str) -> str:
    """Return a message with each field that stands between backticks, such as `probe_spp`, spelled ``--probe-spp``."""
    return re.sub("`([a-z_0-9]+)`", lambda found: _OPTIONS.get(found[1], f"--{found[1].replace('_', '-')}"), message)
