"""Frames for files."""

import pytest

from clsim.live.options import LiveOptions
from clsim.live.rendering import Rendering
from clsim.render import scene_data, view
from clsim.render.paths.integrator import build_kernel


@pytest.mark.parametrize("method", ["esim", None])
def test_no_kernel_is_compiled_that_does_not_render(method, monkeypatch):
    """One takes seconds; with plain paths, frames have variances, which those of a live run have not."""
    built = []

    def noted(features, tree):
        built.append(features)
        return build_kernel(features, tree)

    monkeypatch.setattr(scene_data, "build_kernel", noted)
    monkeypatch.setattr(view, "build_kernel", noted)
    options = LiveOptions(scene="still", resolution=(8, 6), frame_count=1, **({"method": method} if method else {}))
    assert len(list(Rendering(options).frames())) == 1
    ahead, used = built
    assert ahead == used


def test_frames_tell_of_their_light_in_lux_for_a_sensor_that_sees_them_later(tmp_path):
    (tmp_path / "dim.toml").write_text(
        "[sensor]\nlux_per_unit = 7.0\n[camera]\nposition = [0, 0, 9]\n[[objects]]\nshape = 'box'\n"
    )
    options = LiveOptions(str(tmp_path / "dim.toml"), frame_count=1, seed=3)
    seen_by = Rendering(options).about["seen_by"]
    assert (seen_by["sensor"], seen_by["seed"], seen_by["lux_per_unit"]) == (None, 3, 7.0)
