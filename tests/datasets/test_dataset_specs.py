"""The bundled specifications: what they draw can be run, and holds what they are for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clsim.datasets.job import run_job, sequence_folder
from clsim.datasets.load import Sequence
from clsim.datasets.scene_file import scene_text
from clsim.datasets.spec import load_spec
from clsim.scene import load_world
from clsim.scene.modulation import Pwm, Sine


@pytest.mark.slow
@pytest.mark.parametrize("index", [0, 1])
def test_events_of_the_flicker_set_have_the_frequency_of_the_lamp(tmp_path, index):
    """The lamp alone: the spectrum of ON less OFF events has its peak at the frequency that was drawn."""
    spec = load_spec("flicker")
    scene = spec.scene | {"objects": [each for each in spec.scene["objects"] if each.get("name") != "marker"]}
    small = replace(spec, scene=scene, run=spec.run | {"resolution": [32, 24]})
    done = run_job(small, index, str(tmp_path), None)
    lamp = small.sample(index, len(done.rejected)).scene["sphere_lights"][0]["modulation"]
    assert done.kept and lamp["depth"] > 0.15
    with Sequence(sequence_folder(tmp_path, index)) as sequence:
        events = sequence.events()
    signs = np.where(events["on"], 1.0, -1.0)
    rate = np.histogram(events["t"], np.arange(0, 100_001, 500), weights=signs)[0]
    power = np.abs(np.fft.rfft(rate)) ** 2
    assert np.fft.rfftfreq(len(rate), 5e-4)[power.argmax()] == pytest.approx(lamp["frequency_hz"], abs=5.1)


def test_the_flicker_set_is_rendered_fast_enough(tmp_path):
    spec, path = load_spec("flicker"), tmp_path / "scene.toml"
    for index in range(8):
        sample = spec.sample(index)
        path.write_text(scene_text(sample.scene))
        world = load_world(str(path))
        (lamp,) = world.sphere_lights
        (marker,) = (each.modulation for each in world.materials if each.modulation is not None)
        assert isinstance(lamp.modulation, Sine) and isinstance(marker, Pwm)
        assert 1000 <= lamp.modulation.least_fps <= sample.run["fps"]
        assert marker.least_fps <= sample.run["fps"]
