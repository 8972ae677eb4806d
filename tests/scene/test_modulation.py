"""How light changes: exact means against sums of many instants, and what the TOML says."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from clsim.errors import InputError
from clsim.scene import load_world, validate
from clsim.scene.modulation import Keyframed, Modulation, Pwm, Sine, missed

FREQUENCIES = st.floats(1.0, 500.0)
SHARES = st.floats(0.0, 1.0)
PHASES = st.floats(-400.0, 400.0)
COLOURS = st.tuples(*[st.floats(0.0, 3.0)] * 3)


@st.composite
def keyframed(draw: st.DrawFn) -> Keyframed:
    gaps = draw(st.lists(st.floats(0.005, 0.03), min_size=1, max_size=5))
    times_s = tuple(np.cumsum(gaps) - draw(st.booleans()) * gaps[0])
    factors = tuple(draw(st.lists(COLOURS, min_size=len(times_s), max_size=len(times_s))))
    return Keyframed(times_s, factors, draw(st.booleans()), draw(st.booleans()))


MODULATIONS = st.one_of(
    st.builds(Sine, FREQUENCIES, SHARES, PHASES),
    st.builds(Pwm, FREQUENCIES, SHARES, SHARES, PHASES),
    keyframed(),
)


@settings(max_examples=40)
@given(change=MODULATIONS, start_s=st.floats(-0.01, 0.2), length_s=st.floats(1e-3, 0.05))
def test_the_mean_over_an_exposure_is_that_of_its_instants(change: Modulation, start_s: float, length_s: float) -> None:
    middles = start_s + length_s * (np.arange(500) + 0.5) / 500
    instants = np.array([change.mean(t, t) for t in middles])
    assert instants.min() >= 0 and instants.max() <= change.largest + 1e-12
    # A sum over instants is off by the jumps within it, each by at most one of its steps.
    jumps = 2 + length_s * change.least_fps
    np.testing.assert_allclose(
        change.mean(start_s, start_s + length_s), instants.mean(axis=0), atol=1e-4 + 3 * jumps / 500, rtol=0
    )


def test_a_sine_is_what_it_says() -> None:
    lamp = Sine(100.0, 0.5, 30.0)
    for t in (0.0, 0.0017, 0.8231):
        assert lamp.mean(t, t) == pytest.approx([1 + 0.5 * math.sin(2 * math.pi * 100 * t + math.pi / 6)] * 3)
    assert lamp.mean(0.0, 0.01) == pytest.approx([1.0] * 3), "a whole period has no flicker"
    # By hand: half a period of a sine from 0 has the mean 2/π.
    assert Sine(100.0, 1.0).mean(0.0, 0.005) == pytest.approx([1 + 2 / math.pi] * 3)


def test_a_switched_lamp_is_on_from_each_periods_start_whatever_times_round_to() -> None:
    lamp = Pwm(100.0, 0.25, low=0.1)
    for k in range(300):
        start_s = (k * 10_000) * 1e-6
        assert lamp.mean(start_s, start_s)[0] == 1.0, k
        assert lamp.mean(start_s + 2.4e-3, start_s + 2.4e-3)[0] == 1.0
        off_s = (k * 10_000 + 2_500) * 1e-6
        assert lamp.mean(off_s, off_s)[0] == lamp.mean(off_s + 7.4e-3, off_s + 7.4e-3)[0] == pytest.approx(0.1)
    assert lamp.mean(0.0, 0.02) == pytest.approx([0.1 + 0.9 * 0.25] * 3)
    assert lamp.mean(0.002, 0.003) == pytest.approx([0.55] * 3)
    assert Pwm(100.0, 0.25, phase_deg=90.0).mean(0.0, 0.0)[0] == 0.0, "a quarter of the period has passed"
    assert Pwm(100.0, 0.25, phase_deg=90.0).mean(7.6e-3, 7.6e-3)[0] == 1.0, "and after three more it is on again"


def test_keyframes_are_held_joined_and_repeated() -> None:
    red, blue, dark = (1.0, 0.0, 0.0), (0.0, 0.0, 2.0), (0.0, 0.0, 0.0)
    once = Keyframed((0.1, 0.2, 0.4), (red, blue, dark))
    assert (once.duration_s, once.largest, once.least_fps) == (0.4, 2.0, pytest.approx(20.0))
    for t, expected in ((0.0, red), (0.15, (0.5, 0.0, 1.0)), (0.3, (0.0, 0.0, 1.0)), (0.9, dark)):
        assert once.mean(t, t) == pytest.approx(expected), t
    steps = Keyframed((0.0, 0.2, 0.4), (red, blue, dark), step=True, repeat=True)
    assert steps.duration_s == 0.0
    for t, expected in ((0.0, red), (0.19, red), (0.2, blue), (0.4, red), (0.61, blue), (1.2, red)):
        assert steps.mean(t, t) == pytest.approx(expected), t
    assert steps.mean(0.3, 0.5) == pytest.approx((0.5, 0.0, 1.0))
    assert Keyframed((0.0,), (blue,), repeat=True).mean(3.0, 3.5) == pytest.approx(blue)


def test_frames_too_few_for_the_fastest_light_are_told() -> None:
    lamps = [("slow", Sine(10.0)), ("mains", Sine(120.0, 0.3)), ("steady", Sine(1e6, 0.0)), ("full", Pwm(1e6, 1.0))]
    assert missed(lamps, 1200.0) is None
    assert missed(lamps, 120.0) == (
        "the light of mains changes too fast for 120 frames per simulated second, so that it looks slower than it is, "
        "or constant: expected `fps` of at least 1200"
    )
    assert "at least 10000" in str(missed([("marker", Pwm(500.0, 0.9))], 9_999.0))
    assert missed([("marker", Pwm(500.0, 0.9))], 10_000.0) is None


SCENE = """
[camera]
position = [0.0, 0.0, 3.0]
[environment]
radiance = [1.0, 1.0, 1.0]
map_turn_deg_per_s = 90.0
modulation = { kind = "sine", frequency_hz = 120, depth = 0.25, phase_deg = 10.0 }
[materials.marker]
emission = [3.0, 0.0, 0.0]
[materials.marker.modulation]
kind = "keyframes"
interpolation = "step"
repeat = true
keyframes = [{ time_s = 0.0, factor = 1.0 }, { time_s = 0.5, factor = [0.0, 0.5, 0.25] }, { time_s = 1.0, factor = 0 }]
[[objects]]
shape = "box"
material = "marker"
[[lights]]
kind = "point"
intensity = [1.0, 1.0, 1.0]
modulation = { kind = "keyframes", keyframes = [{ time_s = 0.0, factor = 1.0 }, { time_s = 2.5, factor = 0.0 }] }
[[sphere_lights]]
name = "led"
radius_m = 0.1
radiance = [5.0, 5.0, 5.0]
modulation = { kind = "pwm", frequency_hz = 480, duty = 0.3, low = 0.01, phase_deg = 5.0 }
"""


def scene(folder: Path, text: str = SCENE) -> Path:
    path = folder / "flicker.toml"
    path.write_text(text)
    return path


def test_a_scene_says_how_its_light_changes(tmp_path: Path) -> None:
    world = load_world(scene(tmp_path))
    factors = ((1.0, 1.0, 1.0), (0.0, 0.5, 0.25), (0.0, 0.0, 0.0))
    assert world.modulations() == [
        ("led", Pwm(480.0, 0.3, 0.01, 5.0)),
        ("a lamp", Keyframed((0.0, 2.5), ((1.0, 1.0, 1.0), (0.0, 0.0, 0.0)))),
        ("marker", Keyframed((0.0, 0.5, 1.0), factors, step=True, repeat=True)),
        ("the environment", Sine(120.0, 0.25, 10.0)),
    ]
    assert world.light_changes() and world.duration_s == 2.5, "until what ends has ended"
    assert not world.light_repeats(2.5) and world.light_repeats(0.0)


def test_wrong_modulations_are_told_with_their_keys(tmp_path: Path) -> None:
    text = SCENE.replace('"sine"', '"sinus"').replace("duty", "dutty").replace("factor = 0.0", "factor = -1.0")
    with pytest.raises(InputError) as error:
        load_world(scene(tmp_path, text))
    assert "environment.modulation: expected a kind out of 'sine', 'pwm', 'keyframes', got {'kind': 's" in str(
        error.value
    )
    assert "sphere_lights[0].modulation.dutty: unknown key, did you mean 'duty'?" in str(error.value)
    assert "lights[0].modulation.keyframes[1].factor: expected greater than or equal to 0, got -1.0" in str(error.value)
    for times in ("0.5, 0.5", "0.5, 0.2"):
        text = SCENE.replace("time_s = 0.5, f", f"time_s = {times.split(', ')[0]}, f").replace(
            "time_s = 1.0, f", f"time_s = {times.split(', ')[1]}, f"
        )
        with pytest.raises(InputError, match=rf"marker\.modulation\.keyframes: times must increase, got 0\.0, {times}"):
            load_world(scene(tmp_path, text))


@pytest.mark.parametrize("factors", [((1.0, 1.0, 1.0), (1.0, -0.5, 1.0)), ((math.nan, 1.0, 1.0), (1.0, 1.0, 1.0))])
def test_light_that_cannot_be_is_refused(factors: tuple[tuple[float, float, float], ...]) -> None:
    world = replace(load_world("still"), environment_modulation=Keyframed((0.0, 1.0), factors))
    with pytest.raises(InputError, match="the light of the environment: changes by"):
        validate(world, "made")


def test_a_lamp_that_is_brighter_while_off_is_so_at_most() -> None:
    assert (Pwm(100.0, low=2.0).largest, Pwm(100.0, low=0.5).largest) == (2.0, 1.0)


@pytest.mark.parametrize("step", [False, True])
def test_repeated_keyframes_that_begin_late_hold_the_first_until_then_in_each_pass(step: bool) -> None:
    light = Keyframed((0.1, 0.2, 0.4), ((1.0, 0.5, 0.0), (0.0, 0.0, 2.0), (0.0, 3.0, 0.0)), step=step, repeat=True)
    for start_s, end_s in ((0.05, 0.95), (0.4, 1.2), (0.45, 0.47), (0.3, 0.45)):
        middles_s = start_s + (end_s - start_s) * (np.arange(4000) + 0.5) / 4000
        sampled = np.mean([light.mean(at_s, at_s) for at_s in middles_s.tolist()], axis=0)
        assert light.mean(start_s, end_s) == pytest.approx(sampled, abs=2e-3)
