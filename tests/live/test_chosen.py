"""A run says what was chosen and why."""

import pytest

from clsim.live.options import LiveOptions
from clsim.live.stages import plan_stages


@pytest.mark.parametrize(
    ("options", "light", "times"),
    [
        ({"scene": "two-boxes"}, "nothing but the camera of two-boxes moves", "120 times a second, in frames"),
        ({"scene": "cornell"}, "paths that meet that are traced again, of 64 or more", "in frames"),
        ({"scene": "cornell", "sampling": "adaptive"}, "`sampling` adaptive: light is traced anew", "in frames"),
        ({"scene": "two-boxes", "quality": "exact"}, "`sampling` uniform: light is traced anew", "in frames"),
        ({"scene": "cornell", "time": "adaptive"}, "traced again", "between them where it changes, to 100 µs"),
    ],
)
def test_how_light_is_known_and_when_brightness_is_found(options: dict[str, str], light: str, times: str) -> None:
    stages = plan_stages(LiveOptions(**options))
    quality, about_light, about_times = stages.chosen
    assert quality.startswith(f"`quality` {options.get('quality', 'balanced')}: ")
    assert light in about_light and times in about_times


def test_where_lights_are_set_from_outside_they_are_followed() -> None:
    assert "traced again" in plan_stages(LiveOptions(scene="two-boxes"), lights_set=True).chosen[1]
