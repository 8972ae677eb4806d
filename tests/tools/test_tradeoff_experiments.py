"""The table maker of experiments, on pictures of a few pixels."""

import json

import numpy as np
import pytest

from clsim.detect.config import DetectorConfig
from clsim.detector import Detector
from tools import tradeoff_experiments as tables
from tools import tradeoff_prototypes as tool

pytestmark = pytest.mark.slow  # many kernels, for a tool of research

SIZE = (16, 12)


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    studio = tool.Studio(tmp_path_factory.mktemp("frames"), SIZE, 4, 0.02, 16)
    return tool.Case(studio, tool.Take("moving-light", 4))


def test_levels_fire_as_the_detector_does(case):
    options = {"window": 5, "regress": "linear", "shrink": 1.5}
    frames = case.frames
    detector = Detector(
        DetectorConfig(method="wlr-esim", threshold_on=0.02, threshold_off=0.02, precision="float64", **options),
        *SIZE, frames.names,
    )  # fmt: skip
    expected = np.concatenate([detector.step(frame) for frame in tool.each(frames)])
    found = case.studio.fire(tool.fitted(frames, precision="float64", **options), frames.times)
    assert len(expected) > 10
    # Levels pass through float32.
    assert len(found) == len(expected) and np.abs(found["t"] - expected["t"]).max() <= 2


def test_numpy_fits_as_the_kernels(case):
    options = {"window": 5, "regress": "linear", "shrink": 1.5}
    found = tool.log(tool.numpy_fit(case.frames, **options).alpha.reshape(case.frames.luminance.shape))
    np.testing.assert_allclose(found, tool.fitted(case.frames, precision="float64", **options), atol=1e-5)
    shifted = tool.log_shrunk(0, **{**options, "shrink": 0.0})(case)
    np.testing.assert_allclose(shifted, tool.fitted(case.frames, window=5, precision="float64"), atol=1e-5)
    useless = np.ones(case.frames.luminance.shape)
    same = tool.numpy_fit(case.frames, useless, **options).alpha
    np.testing.assert_allclose(tool.log(same).reshape(found.shape), found, atol=1e-9)


def test_a_still_camera_reprojects_each_pixel_on_itself(case):
    y = case.frames.luminance
    blended = [y[0]]
    for now in y[1:]:
        blended.append(0.25 * blended[-1] + 0.75 * now)
    hit = case.frames.plane("Depth").min(axis=0) > 0
    assert hit.mean() > 0.7
    np.testing.assert_allclose(tool.reprojected(0.25)(case)[:, hit], tool.log(np.stack(blended))[:, hit], atol=1e-5)


def test_a_moving_camera_finds_the_surface_it_saw(tmp_path):
    """Clean frames of a moving camera: what was seen before, brought to where it is now, is nearly what is seen."""
    studio = tool.Studio(tmp_path, (64, 48), 25, 0.1, 16)
    moving = tool.Case(studio, tool.Take("two-boxes", 16))
    all_frames = moving.frames
    ends = [0, -1]
    moving.frames = tool.Frames(all_frames.planes[ends], all_frames.names, all_frames.times[ends])
    before, after = tool.esim(moving.frames)
    brought = np.abs(tool.reprojected(1.0)(moving)[1] - after)
    assert np.mean(brought) < 0.5 * np.mean(np.abs(before - after))


def test_tables_have_a_row_and_column_for_everything(tmp_path, monkeypatch):
    out, data, picture = tmp_path / "tables.md", tmp_path / "figures.json", tmp_path / "plot.png"
    options = {"cache": tmp_path / "frames", "scenes": "moving-light", "spp": "2,4", "groups": "summary,noise",
               "resolution": "16x12", "frames": 4, "reference-spp": 16, "threshold": 0.1, "out": out, "json": data,
               "plot": picture}  # fmt: skip
    arguments = [text for name, value in options.items() for text in (f"--{name}", str(value))]
    monkeypatch.setattr("sys.argv", ["tradeoff_experiments.py", *arguments])
    tables.main()
    lines = [line for line in out.read_text().splitlines() if line.startswith("| ")]
    labels = [line.split("|")[1].strip() for line in lines]
    for group in ("summary", "noise"):
        assert set(tables.GROUPS[group][1]) <= set(labels)
    assert labels.count("ceiling") == 2 and all(line.count("|") == 4 for line in lines)
    figures = json.loads(data.read_text())["summary"]["esim"]["moving-light 4"]
    assert lines[1].endswith(f"| {tables.cell(figures)} |")
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_every_row_runs(case):
    """At 4 samples of a tiny picture figures mean nothing, but a row that cannot run shows."""
    clean = case.sibling()
    shape = (4, *SIZE[::-1])
    for _, rows in tables.GROUPS.values():
        for label, row in rows.items():
            made = row(clean)
            assert made.dtype.names or (made.shape == shape and np.isfinite(made).all()), label
