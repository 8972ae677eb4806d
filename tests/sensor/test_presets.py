"""Sensors by name and from files: what each says, where it is from, and what is refused."""

import contextlib
import math
from dataclasses import fields, is_dataclass, replace
from itertools import combinations

import numpy as np
import pytest

from clsim.detect.config import DetectorConfig
from clsim.detector import check_sensor
from clsim.errors import InputError
from clsim.live.options import LiveOptions
from clsim.live.stages import plan_stages
from clsim.sensor import SensorSettings, Specimen, load_sensor, preset_names
from clsim.sensor.lab import Lab
from clsim.sensor.pixel_stages import Noise
from clsim.sensor.settings import STAGES as STAGES_IN_ORDER
from clsim.sensor.stage import Context

CAMERAS = {
    "atis": (304, 240),
    "davis240": (240, 180),
    "davis346": (346, 260),
    "dvs128": (128, 128),
    "dvxplorer": (640, 480),
    "gen3.1": (640, 480),
    "gen4.1": (1280, 720),
    "imx636": (1280, 720),
    "genx320": (320, 320),
}
KINDS = ("data sheet", "paper", "code", "recording", "guess", "shared")
"""Where numbers are from: a maker's own words, a paper, the text of a program, clsim's reading of a recording, nowhere,
or another camera."""
SIMULATORS = ("ideal", "v2e-clean", "v2e-noisy")


def numbers_that_differ(settings):
    """Return the names, as "stage.number", of all that is not as in the ideal sensor."""
    ideal = SensorSettings()
    return {
        f"{group.name}.{number.name}"
        for group in fields(settings)
        if is_dataclass(getattr(ideal, group.name))
        for number in fields(getattr(ideal, group.name))
        if getattr(getattr(settings, group.name), number.name) != getattr(getattr(ideal, group.name), number.name)
    }


def test_no_preset_is_left_out_here():
    assert set(preset_names()) == {*CAMERAS, *SIMULATORS}


@pytest.mark.parametrize("name", CAMERAS)
def test_a_camera_has_its_chip_and_every_kind_of_fault_that_all_have(name):
    settings = load_sensor(name.upper())
    assert (settings.optics.width, settings.optics.height) == CAMERAS[name]
    assert {"MISMATCH", "DARK", "RECEPTOR", "FOLLOWER", "RATE_NOISE", "LEAK", "REFRACTORY"} <= set(settings.macros)
    assert settings.name == {"imx636": "gen4.1"}.get(name, name)


@pytest.mark.parametrize("name", preset_names())
def test_every_number_has_a_source_and_every_source_its_number(name):
    settings = load_sensor(name)
    assert numbers_that_differ(settings) == set(settings.sources)
    for source in settings.sources.values():
        kind, _, what = source.partition(": ")
        assert (kind in KINDS and len(what) > 3) or source.removeprefix("as ") in settings.sources, source


def stream_of(name):
    """Return what a grating fires that drifts for 0.3 s before 40×30 pixels of a camera, at some 100 lux."""
    lab = Lab(load_sensor(name), 40, 30, seed=5)
    x, y = np.meshgrid(np.arange(40), np.arange(30))
    parts = [
        lab.to(t, np.sin(0.4 * x + 0.15 * y + 2e-5 * t) + 0.3 * np.sin(1.1 * y - 5e-6 * t)).events.copy()
        for t in range(0, 300_001, 2000)
    ]
    return np.concatenate(parts)


@pytest.mark.slow
def test_no_two_cameras_fire_the_same_stream():
    streams = {name: stream_of(name) for name in CAMERAS if name != "imx636"}
    assert min(map(len, streams.values())) > 3000
    for (one, events), (other, others) in combinations(streams.items(), 2):
        same = len(np.intersect1d(events, others)) / min(len(events), len(others))
        assert same < 0.05, f"{one} and {other} share {same:.0%} of their events"
    np.testing.assert_array_equal(stream_of("imx636"), streams["gen4.1"])


def test_what_tells_cameras_apart_is_told_of_each():
    """Thresholds, bandwidth, noise, leak, rest and readout: two cameras have the same numbers only if one says so."""
    cameras = {name: load_sensor(name) for name in CAMERAS if name != "imx636"}
    for (one, a), (other, b) in combinations(cameras.items(), 2):
        for group in ("threshold", "front_end", "noise", "leak", "refractory", "delay", "readout"):
            if getattr(a, group) != getattr(b, group) or not getattr(a, group).__dict__:
                continue
            sources = [text for each in (a, b) for key, text in each.sources.items() if key.startswith(group)]
            assert any("shared" in text or "guess" in text or "libcaer" in text for text in sources), (
                one,
                other,
                group,
            )


def test_noise_of_v2e_falls_by_three_quarters_from_black_to_white():
    noise = load_sensor("v2e-noisy").noise
    for lux, on, off in zip(noise.lux, noise.on_hz, noise.off_hz, strict=True):
        assert on == off == pytest.approx(2.5 * (1 - 0.75 * (lux * 2.55 + 20) / 275), abs=6e-4)


@pytest.mark.parametrize(("name", "per_s"), [("davis346", 12e6), ("dvxplorer", 165e6), ("gen4.1", 1.066e9)])
def test_a_bus_takes_as_long_as_its_largest_rate_says(name, per_s):
    # In whole ns, which is what the bus counts.
    assert load_sensor(name).readout.event_us * 1e3 == round(1e9 / per_s)


def test_a_field_of_view_is_that_of_the_lens_it_names():
    assert load_sensor("davis240").optics.fov_deg == pytest.approx(math.degrees(2 * math.atan(120 / 199.4)), abs=0.05)
    optics = load_sensor("davis346").optics
    width_mm = optics.width * optics.pitch_um * 1e-3
    assert optics.fov_deg == pytest.approx(math.degrees(2 * math.atan(width_mm / 2 / 4.5)), abs=0.05)


def test_a_preset_sets_the_camera_unless_asked_for_otherwise():
    plain = plan_stages(LiveOptions("two-boxes")).world.camera
    seen = plan_stages(LiveOptions("two-boxes", sensor="gen4.1"))
    assert (seen.world.camera.width, seen.world.camera.height) == (1280, 720)
    assert seen.world.camera.fov_deg == plain.fov_deg  # that sensor names no lens
    assert (seen.detector.threshold_on, seen.detector.threshold_off) == (0.25, 0.25)
    davis = plan_stages(LiveOptions("two-boxes", sensor="davis346")).world.camera
    assert davis.fov_deg == 70.8 != plain.fov_deg
    other = plan_stages(LiveOptions("two-boxes", sensor="davis346", resolution=(32, 24), threshold=(0.3, 0.4)))
    assert (other.world.camera.width, other.world.camera.height) == (32, 24)
    assert (other.detector.threshold_on, other.detector.threshold_off) == (0.3, 0.4)


def written(folder, text, name="mine.toml"):
    file = folder / name
    file.write_text(text)
    return str(file)


def test_one_rate_of_noise_over_a_base_with_several_holds_in_all_light(tmp_path):
    noise = load_sensor(written(tmp_path, 'base = "davis346"\n[noise]\non_hz = 0.5\n')).noise
    assert noise.on_hz == (0.5,) and len(noise.off_hz) == len(noise.lux) == 3
    constants = noise.constants(Context(0.2, 0.2, 100.0))
    assert constants["RATE_ON"] == (0.5, 0.5, 0.5) and constants["RATE_OFF"] == noise.off_hz
    assert constants["RATE_MOST"] == 0.5 + max(noise.off_hz)
    with pytest.raises(InputError, match="`off_hz` has 2 numbers, expected 3"):
        replace(noise, off_hz=(1.0, 2.0))


@pytest.mark.parametrize(
    ("text", "reads"),
    [
        ("[noise]\nlux = [1, 100]\non_hz = [2, 1]\noff_hz = [2, 1]\n", True),
        ("[noise]\non_hz = 2\n", False),
        ("[front_end]\ndark_lux = 0.1\n", True),
        ("[front_end]\nreceptor_hz_per_lux = 10\n", True),
        ("[front_end]\nfollower_hz = 500\n", False),
        ("[leak]\nparasitic_hz_per_lux = 1e-4\n", True),
        ("[leak]\nhz = 0.1\n", False),
    ],
)
def test_how_many_lux_there_are_matters_to_some_sensors_alone(tmp_path, text, reads):
    """What those see must be the logarithm of light, whatever else a detector can make of it."""
    specimen = Specimen(load_sensor(written(tmp_path, text)), 0, 100.0)
    with pytest.raises(InputError, match="needs ln") if reads else contextlib.nullcontext():
        check_sensor(DetectorConfig(method="esim", response="lin-log"), specimen)


@pytest.mark.parametrize("name", ["gen4.1", "imx636", "IMX636"])
def test_a_base_may_be_any_name_of_a_preset(tmp_path, name):
    mine = load_sensor(written(tmp_path, f'base = "{name}"\n'))
    assert mine == replace(load_sensor("gen4.1"), name="mine")


def test_a_file_says_what_differs_from_its_base(tmp_path):
    mine = load_sensor(written(tmp_path, 'base = "davis346"\n[threshold]\non = 0.3\n[defects]\nhot_share = 0.001\n'))
    davis = load_sensor("davis346")
    assert mine.name == "mine" and mine.threshold.on == 0.3 and mine.threshold.off == davis.threshold.off
    assert mine.defects.hot_share == 0.001 and mine.leak == davis.leak and mine.optics == davis.optics


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[treshold]\non = 0.2\n", "treshold"),
        ("[threshold]\nonn = 0.2\n", "onn"),
        ("[leak]\nhz = -1\n", "`hz` must not be negative, got -1"),
        ('[leak]\nhz = "much"\n', "hz"),
        ("leak = 3\n", "leak"),
        ("[threshold\n", "is no TOML"),
        ('base = "mine.toml"\n', "is its own `base`"),
        ('base = "other.toml"\n', "other.toml: cannot be read"),
        ("[noise]\non_hz = [1, 2]\n", "`on_hz` has 2 numbers, expected 1"),
        ("[noise]\nshot = 0.1\n", "follower_hz"),
        ("[optics]\nfov_deg = 180\n", "`fov_deg` must be less than 180, got 180"),
        ("[optics]\nwidth = 640\n", "`width` and `height` belong together"),
    ],
)
def test_what_a_file_may_not_say_is_told_in_a_sentence(tmp_path, text, told):
    with pytest.raises(InputError) as error:
        load_sensor(written(tmp_path, text))
    message = str(error.value)
    assert told in message and ".toml: " in message and "\n" not in message


def test_a_name_that_is_nearly_one_is_recognised():
    with pytest.raises(InputError, match="no sensor 'davis364'; did you mean davis346"):
        load_sensor("davis364")
    with pytest.raises(InputError, match=r"expected one of atis, .*, or a \.toml file"):
        load_sensor("retina")


@pytest.mark.parametrize(
    ("lux", "on_hz", "message"),
    [
        ((10.0, 10.0), (2.0, 1.0), "`lux` must rise, got 10, 10"),
        ((20.0, 10.0), (2.0, 1.0), "`lux` must rise, got 20, 10"),
        ((10.0, 20.0), (2.0, 1.0, 0.5), "`on_hz` has 3 numbers, expected 2, as many as `lux`"),
        ((), (2.0, 1.0), "`on_hz` has 2 numbers, expected 1"),
    ],
)
def test_rates_of_noise_belong_to_lights_that_rise(lux, on_hz, message):
    with pytest.raises(InputError, match=message):
        Noise(on_hz, lux=lux)
    assert Noise((3.0,), lux=lux[:1]).on_hz == (3.0,)


STAGES = {
    "front_end": {"dark_lux": 0.1, "receptor_hz_per_lux": 5.0, "follower_hz": 300.0},
    "noise": {"on_hz": (1.0, 3.0), "off_hz": (2.0, 1.0), "lux": (1.0, 10.0), "spread_decades": 0.1, "shot": 0.0},
    "leak": {"hz": 0.1, "spread_decades": 0.2, "parasitic_hz_per_lux": 1e-4},
    "defects": {"hot_share": 0.1, "hot_hz": 50.0, "hot_spread_decades": 0.3, "dead_share": 0.1},
    "refractory": {"us": 20.25},
    "delay": {"latency_us": 3.0, "jitter_us": 2.0},
    "threshold": {"on": 0.2, "off": 0.3, "mismatch": 0.01},
}
"""Numbers of each stage that is on, all of which mean something."""


@pytest.mark.parametrize(("stage", "name"), [(stage, name) for stage, numbers in STAGES.items() for name in numbers])
def test_each_number_of_a_stage_is_what_pixels_are_built_with(stage, name):
    """By half and by a thousandth more it is another one, and no other's."""

    def built(numbers):
        settings = SensorSettings(**{"front_end": STAGES["front_end"], stage: numbers})
        on, off = settings.threshold.on or 0.2, settings.threshold.off or 0.2
        found = settings.stages[[*STAGES_IN_ORDER].index(stage)]
        return on, off, settings.macros, found.constants(Context(on, off, 100.0, settings.front_end.follower_s))

    numbers = STAGES[stage]
    assert {*numbers} == {field.name for field in fields(getattr(SensorSettings(), stage))}
    value = numbers[name]
    changes = [
        tuple(factor * each for each in value) if isinstance(value, tuple) else factor * value or 0.5
        for factor in (1.5, 1.001)
    ]
    found = [built(numbers | {name: each}) for each in (value, *changes)]
    others = [
        built(numbers | {other: 1.5 * each})
        for other, each in numbers.items()
        if other != name and isinstance(each, float) and each
    ]
    assert found[0] not in found[1:] and found[1] not in others and (found[1] != found[2] or value == 0.0)
