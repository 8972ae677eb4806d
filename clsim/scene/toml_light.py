"""Light that changes, from a scene's TOML."""

from __future__ import annotations

from typing import TYPE_CHECKING

from clsim.scene.modulation import Keyframed, Modulation, Pwm, Sine

if TYPE_CHECKING:
    from clsim.scene import schema


def read_modulation(table: schema.SineTable | schema.PwmTable | schema.LightKeyframesTable | None) -> Modulation | None:
    """Return how a light changes with time; None where it does not."""
    if table is None:
        return None
    if table.kind == "sine":
        return Sine(table.frequency_hz, table.depth, table.phase_deg)
    if table.kind == "pwm":
        return Pwm(table.frequency_hz, table.duty, table.low, table.phase_deg)
    factors = tuple(
        key.factor if isinstance(key.factor, tuple) else (key.factor, key.factor, key.factor) for key in table.keyframes
    )
    times_s = tuple(key.time_s for key in table.keyframes)
    return Keyframed(times_s, factors, table.interpolation == "step", table.repeat)
