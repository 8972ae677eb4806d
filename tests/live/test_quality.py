"""Named points of speed against accuracy, and settings that are given with them."""

import contextlib
import json
from dataclasses import asdict, replace
from typing import get_args, get_type_hints

import pytest
from hypothesis import given
from hypothesis import strategies as st

from clsim.detect.config import DetectorConfig
from clsim.errors import InputError
from clsim.events.outputs import FileOptions
from clsim.live.options import LiveOptions
from clsim.live.quality import DEFAULT, PLAIN, QUALITIES, UNCACHED, Point, Quality, setting_names
from clsim.live.recording_options import RecordingOptions
from clsim.live.stages import plan_stages
from clsim.render import RenderOptions


def options(scene: str = "still", **values: object) -> LiveOptions:
    return LiveOptions(scene, **values)  # type: ignore[arg-type]


def test_every_named_point_can_be_rendered_and_detected() -> None:
    assert set(QUALITIES) == set(get_args(Quality))
    for name, point in QUALITIES.items():
        assert options(quality=name).point == point
        DetectorConfig(method=point.method, window=point.window)
        probe = point.probe_spp if point.sampling != "uniform" else None
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


@pytest.mark.parametrize("quality", [None, *QUALITIES])
@pytest.mark.parametrize("sensor", [None, "davis346"])
def test_each_setting_that_is_given_holds_with_every_quality_and_sensor(
    quality: Quality | None, sensor: str | None
) -> None:
    """Or it is refused: what follows from others are settings that are not given alone."""
    numbers = {"window": (3, 9), "probe_spp": (1, 2), "spp": (2, 64), "first_hit_rays": (0, 16), "probe_every": (1, 3)}
    kinds = get_type_hints(Point)
    held = set()
    for name in setting_names():
        for value in numbers.get(name) or get_args(kinds[name]):
            with contextlib.suppress(InputError):
                assert getattr(options(quality=quality, sensor=sensor, **{name: value}).point, name) == value
                held.add(name)
    # Where all pixels get as many paths, there is no probe.
    assert held >= set(setting_names()) - {"probe_spp"}


def test_another_method_brings_its_own_window_and_fewer_paths_cap_the_probe() -> None:
    assert options(quality="balanced", method="esim-ad").point.window is None
    assert options(quality="balanced", method="esim-ad", window=9).point.window == 9
    assert options(quality="balanced", method="irradiance").point == UNCACHED["balanced"]
    assert options(quality="accurate", spp=1).point.probe_spp == 1


def test_pixels_wait_for_their_probe_only_where_there_is_state_from_frame_to_frame() -> None:
    assert options(method="esim", first_hit_rays=4, probe_every=3).point.probe_every == 3
    assert options(quality="balanced", probe_every=3).point == replace(QUALITIES["balanced"], probe_every=3)
    assert "1 to 8 spp, pixels probed each 16 frames, 32" in QUALITIES["balanced"].text()
    assert "probed" not in UNCACHED["accurate"].text()
    turns = QUALITIES["draft"].probe_every
    assert options(quality="draft", spp=2).point.probe_every == turns
    assert options(quality="draft", noise="independent").point.probe_every == 1
    assert options(quality="draft", first_hit_rays=0).point.probe_every == 1


def test_balanced_holds_unless_a_quality_or_a_method_is_named() -> None:
    assert DEFAULT == "balanced"
    assert options().point == options(governor=False).point == QUALITIES["balanced"]
    assert options(spp=4).point == replace(QUALITIES["balanced"], spp=4)
    for method in ("esim", "wlr-esim", "esim-ad", "irradiance"):
        assert options(method=method).point == replace(PLAIN, method=method)
    assert options(method="irradiance", sampling="adaptive").point == UNCACHED["balanced"]
    assert options(confidence=1.0).point == UNCACHED["balanced"], "which knows the error of each pixel"
    assert options(method="irradiance", pace="real").point == UNCACHED["balanced"]


def test_light_is_linear_between_frames_unless_lines_go_on_from_there() -> None:
    for chosen in ({}, {"sensor": "ideal"}, {"time": "adaptive"}):
        assert options(**chosen).point.event_rule == "linear-light"
    assert options(sensor="davis346").point.event_rule == "interpolated"
    assert options(event_rule="interpolated").point.event_rule == "interpolated"


def test_what_rules_cached_light_out_makes_the_default_uniform() -> None:
    uniform = replace(UNCACHED["balanced"], sampling="uniform", probe_every=1)
    assert options(noise="independent").point == replace(uniform, noise="independent")
    assert options(first_hit_rays=0).point == replace(uniform, first_hit_rays=0)


def test_a_named_method_runs_as_it_always_did() -> None:
    """Figures written down before "balanced" became the default."""
    point = options(method="esim-ad").point
    assert (point.spp, point.sampling, point.first_hit_rays, point.sampler) == (8, "uniform", 0, "pcg")
    assert (point.noise, point.gate, point.event_rule, point.window) == ("common", "radiance", "interpolated", None)


def test_published_is_the_papers_method_with_its_settings() -> None:
    point = options(quality="published").point
    assert (point.method, point.gate, point.event_rule, point.window) == ("esim-ad", "delta-r", "frame", 13)
    assert (point.noise, point.sampling, point.first_hit_rays) == ("independent", "uniform", 0)
    assert options(quality="published", noise="common", gate="radiance").point == replace(
        point, noise="common", gate="radiance"
    )


def test_the_clock_starts_from_balanced_with_and_without_a_governor() -> None:
    balanced = QUALITIES["balanced"]
    assert options(pace="real", governor=False).point == balanced
    assert options(pace="real", governor=False, quality="draft").point == QUALITIES["draft"]
    uniform = replace(UNCACHED["balanced"], sampling="uniform", probe_every=1)
    assert options(pace="real", noise="independent").point == replace(uniform, noise="independent")
    without_rays = replace(uniform, first_hit_rays=0)
    assert options(pace="real", first_hit_rays=0).point == without_rays


def test_a_governor_needs_the_clock_common_noise_and_first_hit_rays() -> None:
    assert options(pace="real").governed and options(pace="real", quality="draft", spp=2).governed
    for values in (
        {"pace": "max"},
        {"pace": "real", "governor": False},
        {"pace": "real", "noise": "independent"},
        {"pace": "real", "quality": "exact"},
        {"pace": "real", "first_hit_rays": 0},
    ):
        assert not options(**values).governed


@pytest.mark.parametrize("scene", ["two-boxes", "cornell", "moving-light", "still"])
def test_no_setting_follows_the_scene(scene: str) -> None:
    """A quality is one row of one table, whatever moves."""
    following = "stored_paths", "lamp_paths", "follow_every", "first_frame_error"
    for name, point in QUALITIES.items():
        stages = plan_stages(options(scene=scene, quality=name))
        assert stages.options.point == point
        render = stages.render
        assert (render.spp, render.first_hit_rays) == (point.spp, point.first_hit_rays)
        assert tuple(getattr(render, name) for name in following) == tuple(getattr(point, name) for name in following)


@pytest.mark.parametrize("quality", QUALITIES)
def test_a_setting_with_its_own_value_changes_nothing(quality: Quality) -> None:
    named = options(quality=quality)
    for name in setting_names():
        value = getattr(named.point, name)
        if (name, named.point.sampling) == ("probe_spp", "uniform"):
            continue  # of no use there, which is told
        assert options(quality=quality, **{name: value}).point == named.point, name
    for scene in ("two-boxes", "cornell", "moving-light"):
        given = {name: getattr(named.point, name) for name in ("spp", "first_hit_rays", "method", "sampling")}
        assert (
            plan_stages(options(scene=scene, quality=quality, **given)).render
            == plan_stages(options(scene=scene, quality=quality)).render
        )


def test_the_sidecar_tells_the_settings_that_hold() -> None:
    about = options(quality="balanced", spp=4).as_dict()
    assert about["quality"] == "balanced" and about["spp"] == 4
    assert about["method"] == QUALITIES["balanced"].method and about["sampling"] == "cached"
    assert options().as_dict()["method"] == "esim" and options().as_dict()["quality"] == "balanced"
    assert options(method="esim-ad").as_dict()["quality"] is None


GIVEN = st.fixed_dictionaries(
    {},
    optional={
        "quality": st.sampled_from(get_args(Quality)),
        "method": st.sampled_from(["esim", "wlr-esim", "esim-ad", "irradiance"]),
        "sampling": st.sampled_from(["uniform", "adaptive", "cached"]),
        "noise": st.sampled_from(["common", "independent"]),
        "gate": st.sampled_from(["radiance", "delta-r"]),
        "event_rule": st.sampled_from(["interpolated", "frame"]),
        "spp": st.integers(1, 64),
        "probe_spp": st.integers(1, 8),
        "probe_every": st.integers(1, 3),
        "first_hit_rays": st.sampled_from([0, 4]),
        "window": st.sampled_from([5, 9]),
        "pace": st.sampled_from(["max", "real"]),
        "resolution": st.just((32, 24)),
        "threshold": st.just((0.2, 0.3)),
        "outputs": st.just(("a.txt", "b.aedat4")),
        "files": st.just(FileOptions(text_time="s")),
    },
)


@given(GIVEN)
def test_any_run_can_be_repeated_from_its_sidecar(given: dict[str, object]) -> None:
    try:
        first = options(**given)
    except InputError:
        return
    again = LiveOptions.from_dict(json.loads(json.dumps(first.as_dict())))
    assert again.as_dict() == first.as_dict() and again.governed == first.governed
    assert (again.resolution, again.threshold, again.files) == (first.resolution, first.threshold, first.files)
    probe = first.point.probe_spp if first.point.sampling != "uniform" else again.point.probe_spp
    assert again.point == replace(first.point, probe_spp=probe)
    config = DetectorConfig(method=first.point.method, window=first.point.window)
    assert DetectorConfig(method=again.point.method, window=again.point.window).side == config.side


@pytest.mark.parametrize(
    ("plain", "message"),
    [
        ({"scene": "still", "resolutoin": [4, 4]}, "there is no option 'resolutoin'; did you mean 'resolution'?"),
        ({}, "`scene` is missing"),
        ({"scene": "still", "spp": "8"}, "`spp` must be a whole number, got '8'"),
        ({"scene": "still", "spp": True}, "`spp` must be a whole number, got True"),
        ({"scene": "still", "fps": True}, "`fps` must be a finite number, got True"),
        ({"scene": "still", "loop": 1}, "`loop` must be true or false, got 1"),
        ({"scene": "still", "resolution": [4]}, "`resolution` must be a list of 2 whole numbers, got [4]"),
        ({"scene": "still", "outputs": 3}, "`outputs` must be a list of texts, got 3"),
        ({"scene": "still", "fps": -1}, "`fps` must be a positive number, got -1.0"),
        ({"scene": "still", "files": {"frame": True}}, "there is no option 'frame'; did you mean 'frames'?"),
        ({"scene": "still", "pace": "slow"}, "`pace` must be one of max, real, got 'slow'"),
    ],
)
def test_what_no_sidecar_could_say_is_refused(plain: dict[str, object], message: str) -> None:
    with pytest.raises(InputError) as caught:
        LiveOptions.from_dict(plain)
    assert str(caught.value) == message


def test_detection_too_is_repeated_from_its_sidecar() -> None:
    config = DetectorConfig(method="wlr-esim", features=("Albedo.R",), threshold_on=0.3)
    first = RecordingOptions("frames", config, fps=30.0, outputs=("a.txt",))
    assert RecordingOptions.from_dict(json.loads(json.dumps(first.as_dict()))) == first


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"sampling": "adaptive", "spp": 4, "probe_spp": 5}, "`probe_spp` must be at most `spp` 4, got 5"),
        (
            {"method": "esim", "probe_spp": 2},
            "`probe_spp` 2 is for `sampling` adaptive or cached, but sampling is uniform",
        ),
        ({"sampling": "adaptive", "probe_spp": 0}, "`probe_spp` must be at least 1, got 0"),
        ({"sampling": "adaptive", "noise": "independent"}, "`sampling` adaptive needs `noise` common, got independent"),
        ({"quality": "balanced", "noise": "independent"}, "`sampling` adaptive needs `noise` common, got independent"),
        (
            {"sampling": "adaptive", "first_hit_rays": 0},
            "`sampling` adaptive needs `first_hit_rays` of at least 1, got 0",
        ),
        ({"probe_every": 0}, "`probe_every` must be at least 1, got 0"),
        ({"method": "esim", "probe_every": 2}, "`probe_every` 2 needs `first_hit_rays` of at least 1, got 0"),
        (
            {"quality": "draft", "probe_every": 3, "noise": "independent"},
            "`probe_every` 3 needs `noise` common, got independent",
        ),
        ({"first_hit_rays": -1}, "`first_hit_rays` must not be negative, got -1"),
        ({"quality": "best"}, "`quality` must be one of draft, balanced, accurate, exact, published, got 'best'"),
        ({"sampling": "random"}, "`sampling` must be one of uniform, adaptive, cached, got 'random'"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_wrong_sampling_is_told_in_a_sentence(given: dict[str, object], message: str) -> None:
    with pytest.raises(InputError) as caught:
        options(**given)
    assert str(caught.value) == message


def test_cached_light_has_points_of_its_own() -> None:
    for name in UNCACHED:
        point = options(quality=name).point
        assert options(quality=name, sampling="cached").point == point
        assert "cached light" in point.text()
        assert options(quality=name, sampling="adaptive").point == replace(UNCACHED[name], sampling="adaptive")
    assert options(sampling="cached").point == QUALITIES[DEFAULT]
    assert options(sampling="cached", spp=2).point == replace(QUALITIES[DEFAULT], spp=2)
    again = LiveOptions.from_dict(options(sampling="cached").as_dict())
    assert again.point == QUALITIES[DEFAULT]


@pytest.mark.parametrize("given", [{"quality": "exact"}, {"first_hit_rays": 0}, {"noise": "independent"}])
def test_light_cannot_be_cached_without_what_it_needs(given: dict[str, object]) -> None:
    with pytest.raises(InputError, match=r"needs `(first_hit_rays|noise)`"):
        options(sampling="cached", **given)


def test_the_text_leaves_out_what_the_method_has_no_use_for() -> None:
    published = QUALITIES["published"]
    assert published.text() == "esim-ad 13x13, 32 spp, pcg, independent noise, gate delta-r, rule frame"
    everywhere = replace(published, method="wlr-esim").text()
    assert everywhere == "wlr-esim 13x13, 32 spp, pcg, independent noise, rule frame"
    assert replace(published, method="esim").text() == "esim, 32 spp, pcg, independent noise, rule frame"
