"""Named points of speed against accuracy, and what holds beside them."""

from dataclasses import asdict, replace
from typing import get_args

import pytest

from clsim.detect.config import DetectorConfig
from clsim.errors import InputError
from clsim.live.options import LiveOptions
from clsim.live.quality import DEFAULT, QUALITIES, Quality
from clsim.render import RenderOptions


def options(**given: object) -> LiveOptions:
    return LiveOptions("still", **given)  # type: ignore[arg-type]


def test_every_named_point_can_be_rendered_and_detected() -> None:
    assert set(QUALITIES) == set(get_args(Quality))
    for name, point in QUALITIES.items():
        assert options(quality=name).point == point
        DetectorConfig(method=point.method, window=point.window)
        probe = point.probe_spp if point.sampling == "adaptive" else None
        RenderOptions(
            spp=point.spp,
            probe_spp=probe,
            probe_every=point.probe_every,
            first_hit_rays=point.first_hit_rays,
            sampler=point.sampler,
        )


def test_what_is_given_wins_over_the_named_point() -> None:
    point = options(quality="accurate", spp=24, sampler="pcg", first_hit_rays=8).point
    expected = asdict(QUALITIES["accurate"]) | {"spp": 24, "sampler": "pcg", "first_hit_rays": 8}
    assert asdict(point) == expected


def test_another_method_brings_its_own_window_and_fewer_paths_cap_the_probe() -> None:
    assert options(quality="balanced", method="esim-ad").point.window is None
    assert options(quality="balanced", method="esim-ad", window=9).point.window == 9
    assert options(quality="balanced", method="irradiance").point.window == QUALITIES["balanced"].window
    assert options(quality="accurate", spp=1).point.probe_spp == 1


def test_pixels_are_probed_in_turn_only_where_light_is_kept_from_frame_to_frame() -> None:
    assert options(first_hit_rays=4, probe_every=3).point.probe_every == 3
    assert options(quality="balanced", probe_every=2).point == replace(QUALITIES["balanced"], probe_every=2)
    assert "1 to 8 spp, pixels probed each 2 frames, 16" in options(quality="balanced", probe_every=2).point.text()
    assert "probed" not in QUALITIES["balanced"].text()
    turns = QUALITIES["draft"].probe_every
    assert options(quality="draft", spp=2).point.probe_every == turns
    assert options(quality="draft", noise="independent").point.probe_every == 1
    assert options(quality="draft", first_hit_rays=0).point.probe_every == 1


def test_without_a_quality_nothing_is_adaptive_unless_the_clock_or_the_user_asks() -> None:
    assert options().point == options(governor=False).point == DEFAULT
    assert options(spp=4).point.spp == 4
    assert options(sampling="adaptive").point == options(pace="real").point == QUALITIES["balanced"]


def test_the_clock_starts_from_balanced_with_and_without_a_governor() -> None:
    balanced = QUALITIES["balanced"]
    assert options(pace="real", governor=False).point == balanced
    assert options(pace="real", governor=False, quality="draft").point == QUALITIES["draft"]
    assert options(pace="real", noise="independent").point == replace(balanced, sampling="uniform")
    without_rays = replace(balanced, sampling="uniform", first_hit_rays=0)
    assert options(pace="real", first_hit_rays=0).point == without_rays


def test_a_governor_needs_the_clock_common_noise_and_first_hit_rays() -> None:
    assert options(pace="real").governed and options(pace="real", quality="draft", spp=2).governed
    for given in (
        {"pace": "max"},
        {"pace": "real", "governor": False},
        {"pace": "real", "noise": "independent"},
        {"pace": "real", "quality": "exact"},
        {"pace": "real", "first_hit_rays": 0},
    ):
        assert not options(**given).governed


def test_the_sidecar_tells_the_settings_that_hold() -> None:
    about = options(quality="balanced", spp=4).as_dict()
    assert about["quality"] == "balanced" and about["spp"] == 4
    assert about["method"] == QUALITIES["balanced"].method and about["sampling"] == "adaptive"
    assert options().as_dict()["method"] == "esim-ad"


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"sampling": "adaptive", "spp": 4, "probe_spp": 5}, "`probe_spp` must be at most `spp` 4, got 5"),
        ({"probe_spp": 2}, "`probe_spp` 2 is for `sampling` adaptive, but sampling is uniform"),
        ({"sampling": "adaptive", "probe_spp": 0}, "`probe_spp` must be at least 1, got 0"),
        ({"sampling": "adaptive", "noise": "independent"}, "`sampling` adaptive needs `noise` common, got independent"),
        ({"quality": "balanced", "noise": "independent"}, "`sampling` adaptive needs `noise` common, got independent"),
        (
            {"sampling": "adaptive", "first_hit_rays": 0},
            "`sampling` adaptive needs `first_hit_rays` of at least 1, got 0",
        ),
        ({"probe_every": 0}, "`probe_every` must be at least 1, got 0"),
        ({"probe_every": 2}, "`probe_every` 2 needs `first_hit_rays` of at least 1, got 0"),
        (
            {"quality": "draft", "probe_every": 3, "noise": "independent"},
            "`probe_every` 3 needs `noise` common, got independent",
        ),
        ({"first_hit_rays": -1}, "`first_hit_rays` must not be negative, got -1"),
        ({"quality": "best"}, "`quality` must be one of draft, balanced, accurate, exact, got 'best'"),
        ({"sampling": "random"}, "`sampling` must be one of uniform, adaptive, got 'random'"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_wrong_sampling_is_told_in_a_sentence(given: dict[str, object], message: str) -> None:
    with pytest.raises(InputError) as caught:
        options(**given)
    assert str(caught.value) == message
