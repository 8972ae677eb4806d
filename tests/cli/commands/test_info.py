import json

import h5py
import numpy as np
import pytest

from clsim.events import EVENT_DTYPE
from clsim.events.files import open_sink
from clsim.events.formats.filesink import FlushPolicy
from clsim.frames import page_aligned
from clsim.frames.exr import ExrWriter
from clsim.scene import bundled_names
from tests.detect.reference_scenes import random_frames
from tests.events.event_data import end_of


def told(clsim, what):
    outcome = clsim("info", what, "--json")
    assert outcome.status == 0, outcome.stderr
    return json.loads(outcome.stdout)


@pytest.fixture
def folder(tmp_path):
    writer = ExrWriter(tmp_path / "frames")
    for frame in random_frames(1, count=3, height=9, width=11, misses=False):
        frame.plane("Nx")[...] = 0.5
        frame.plane("Depth")[...] = 2
        for name in ("R", "G"):
            frame.plane(name)[4, 5] = np.nan
        writer.write(frame)
    return tmp_path / "frames"


def test_frames_and_which_features_they_have(clsim, folder):
    facts = told(clsim, folder)["frames"]
    assert facts["layout"] == "planes" and facts["frames"] == 3 and facts["fps"] == 100
    assert facts["resolution"] == [11, 9] and facts["invalid_pixels"] == 1
    assert facts["features_used"][:2] == ["pixel x", "pixel y"]
    assert {"Ny", "Albedo.R", "Depth"} <= set(facts["features_used"])
    assert facts["features_left_out"] == dict.fromkeys(("Nx", "Coverage"), "constant in the first frame")
    assert "features_left_out    Nx constant in the first frame" in clsim("info", folder).stdout


def test_the_detector_uses_the_features_that_info_names(clsim, folder):
    from clsim.detect.config import DetectorConfig
    from clsim.detector import Detector
    from clsim.frames.exr import ExrSequence

    source = ExrSequence(folder)
    detector = Detector(DetectorConfig(window=3), source.width, source.height, source.names)
    detector.step(next(iter(source)))
    assert ["pixel x", "pixel y", *detector.features] == told(clsim, folder)["frames"]["features_used"]


def test_planes_that_the_files_lack_and_unknown_times(clsim, tmp_path):
    import OpenEXR

    (tmp_path / "f").mkdir()
    for k in range(2):
        image = np.random.default_rng(k).random((4, 6), dtype=np.float32)
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        with OpenEXR.File(header, dict.fromkeys(("R", "G", "B", "Depth"), image)) as file:
            file.write(str(tmp_path / f"f/a{k}.exr"))
    facts = told(clsim, f"{tmp_path}/f/a*.exr")["frames"]
    assert facts["fps"] is None and facts["features_used"] == ["pixel x", "pixel y", "Depth"]
    assert facts["features_left_out"]["Albedo.G"] == "not in the files"


@pytest.mark.parametrize("ending", ["aedat4", "csv"])
def test_event_files(clsim, tmp_path, ending):
    events = np.array([(1000, 3, 4, True), (1500, 9, 0, False), (3000, 0, 7, True)], dtype=EVENT_DTYPE)
    path = tmp_path / f"e.{ending}"
    sink = open_sink(path, 20, 10)
    sink.write(events, end_of(events))
    sink.close()
    facts = told(clsim, path)["events"]
    assert (facts["format"] in (ending, "text")) and facts["events"] == 3
    assert facts["duration_s"] == pytest.approx(0.002) and facts["events_per_s"] == pytest.approx(1500)
    assert facts["on_share"] == pytest.approx(2 / 3) and facts["farthest_pixel"] == [9, 7]
    assert facts["resolution"] in ([20, 10], None)
    if ending == "aedat4":
        assert facts["resolution"] == [20, 10]


def test_a_folder_of_events_with_truth(clsim, tmp_path):
    options = ("--resolution", "32x24", "--frame-count", "4", "--truth", "depth")
    assert (
        clsim("live", "two-boxes", *options, "--out", tmp_path / "run.dsec", "--out", tmp_path / "run.csv").status == 0
    )
    both, alone = told(clsim, tmp_path / "run.dsec"), told(clsim, tmp_path / "run.csv")
    assert both["truth"]["holds"] == ["depth"] and both["truth"]["frames_per_s"] == pytest.approx(120, rel=1e-3)
    assert "truth" not in alone
    facts, file = both["events"], alone["events"]
    assert facts["format"] == "dsec" and facts["events"] == file["events"] > 0
    assert facts["farthest_pixel"] == file["farthest_pixel"]


def test_truth_that_cannot_be_read_hides_no_events(clsim, tmp_path):
    options = ("--resolution", "32x24", "--frame-count", "4", "--truth", "poses,depth", "--quality", "draft")
    assert clsim("live", "two-boxes", *options, "--out", tmp_path / "run.h5").status == 0
    assert told(clsim, tmp_path / "run.h5")["truth"]["holds"] == ["depth", "poses"]
    with h5py.File(tmp_path / "run.h5", "a") as file:
        file.attrs["camera"] = "{"
    facts = told(clsim, tmp_path / "run.h5")
    assert facts["events"]["events"] > 0 and "run.h5" in facts["truth"]["unreadable"]


def test_labels_beside_events_are_told(clsim, tmp_path):
    open_sink(tmp_path / "e.h5", 20, 10, labels=("cause",)).close()
    open_sink(tmp_path / "plain.h5", 20, 10).close()
    assert told(clsim, tmp_path / "e.h5")["events"]["labels"] == ["cause"]
    assert "labels" not in told(clsim, tmp_path / "plain.h5")["events"]


def test_empty_event_file(clsim, tmp_path):
    open_sink(tmp_path / "e.aedat4", 20, 10).close()
    facts = told(clsim, tmp_path / "e.aedat4")["events"]
    assert facts["events"] == 0 and facts["on_share"] is None and facts["events_per_s"] is None
    assert "events_per_s         unknown" in clsim("info", tmp_path / "e.aedat4").stdout


def test_scenes_and_what_is_nothing_of_all(clsim, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "two-boxes").mkdir()
    facts = told(clsim, "two-boxes")
    assert facts["scene"]["triangles"] == facts["scene"]["mesh_triangles"] == 28
    lux = facts["scene"]["illuminance_lux"]
    assert 0 < lux["dark"] < lux["median"] < lux["bright"]
    assert (facts["renderer"]["device"], facts["renderer"]["tree"]) == ("cpu", "bvh16")
    # As a run compiles it for which nothing else is asked.
    assert {"cached light", "Sobol's sequence"} <= set(facts["renderer"]["built in"])
    empty = clsim("info", "./two-boxes")
    assert empty.status == 2 and "no EXR file" in empty.stderr
    assert clsim("info", "nothing.at.all").status == 2
    missing = clsim("info", "gone.aedat4")
    assert missing.status == 2 and "gone.aedat4" in missing.stderr


def test_events_that_are_left_out_are_told(clsim, tmp_path):
    """EVT3 of a camera: two events outside the sensor, the second behind all others."""
    high, low, row, column = 0x8000, 0x6000, 0x0000, 0x2000
    words = [high | 1, low | 7, row | 3, column | 1, column | 20, column | 2, row | 10, column | 3]
    head = b"% evt 3.0\n% geometry 20x10\n% end\n"
    (tmp_path / "a.raw").write_bytes(head + np.array(words, "<u2").tobytes())
    sentence = f"clsim: {tmp_path}/a.raw: 2 events were left out"
    assert told(clsim, tmp_path / "a.raw")["events"]["dropped_events"] == 2
    assert sentence in clsim("info", tmp_path / "a.raw").stderr
    outcome = clsim("convert", tmp_path / "a.raw", tmp_path / "b.txt")
    assert outcome.status == 0 and sentence in outcome.stderr and (tmp_path / "b.txt").read_text().count("\n") == 2
    outcome = clsim("view", tmp_path / "a.raw", "--to", tmp_path / "a.png")
    assert outcome.status == 0 and sentence in outcome.stderr
    outcome = clsim("convert", tmp_path / "b.txt", tmp_path / "c.txt")
    assert outcome.status == 0 and "left out" not in outcome.stderr


@pytest.mark.parametrize(
    ("times_us", "sentence"),
    [
        ((10, 30, 20), "1 event came after a later one and was put in order"),
        ((30, 20, 10), "2 events came after later ones and were put in order"),
        ((10, 20, 30), ""),
    ],
)
def test_events_that_are_put_in_order_are_told(clsim, tmp_path, times_us, sentence):
    source = tmp_path / "a.txt"
    source.write_text("".join(f"{t} 1 2 1\n" for t in times_us))
    for command in (("info", source), ("convert", source, tmp_path / "b.txt")):
        outcome = clsim(*command)
        told_there = [line for line in outcome.stderr.splitlines() if "in order" in line]
        assert outcome.status == 0 and told_there == [f"clsim: {source}: {sentence}"] * bool(sentence)
    assert [int(line.split()[0]) for line in (tmp_path / "b.txt").read_text().splitlines()] == [10, 20, 30]


def test_labels_that_a_format_cannot_hold_are_told(clsim, tmp_path):
    sink = open_sink(tmp_path / "a.h5", 20, 10, labels=("cause",))
    sink.write(np.array([(5, 1, 2, True)], EVENT_DTYPE), 5, np.array([1], np.uint8))
    sink.close()
    for name, lost in (("b.txt", True), ("b.parquet", False)):
        outcome = clsim("convert", tmp_path / "a.h5", tmp_path / name)
        assert outcome.status == 0
        assert (f"{tmp_path}/{name}: its format cannot hold cause of events" in outcome.stderr) == lost


def test_warnings_of_a_scene_come_first_and_what_it_needs_not_is_no_lack(clsim, tmp_path):
    (tmp_path / "dark.toml").write_text("[camera]\nposition = [0, 0, 9]\n[[objects]]\nshape = 'box'\n")
    lines = clsim("info", tmp_path / "dark.toml").stdout.splitlines()
    assert lines[0].startswith("warning: dark: the scene has no light") and lines[1] == "scene"
    assert sum("has no light" in line for line in lines) == 1
    assert any(line.startswith("  not needed here, so not compiled: ") for line in lines)
    facts = told(clsim, tmp_path / "dark.toml")["scene"]
    assert facts["warnings"] and set(facts["illuminance_lux"].values()) == {0.0}


def test_the_light_on_the_sensor_is_told_in_lux(clsim, tmp_path, monkeypatch):
    """A sky of luminance 2, and nothing before it but a far corner; a tall picture is as small as a wide one."""
    shapes = []
    monkeypatch.setattr("clsim.frames.page_aligned", lambda shape: shapes.append(shape) or page_aligned(shape))
    (tmp_path / "sky.toml").write_text(
        "[sensor]\nlux_per_unit = 300.0\n[environment]\nradiance = [2, 2, 2]\n[camera]\nposition = [0, 0, 900]\n"
        "resolution = [4, 16]\n"
        "[[objects]]\nshape = 'box'\n"
    )
    lux = told(clsim, tmp_path / "sky.toml")["scene"]["illuminance_lux"]
    assert list(lux.values()) == pytest.approx([600] * 3)
    assert [shape[1:] for shape in shapes] == [(64, 16)]


def test_statistics_of_a_recording_and_against_another(clsim, tmp_path):
    events = np.array([(0, 3, 1, True), (0, 4, 1, True), (100, 3, 1, False), (300, 3, 1, False)], dtype=EVENT_DTYPE)
    for name, some in (("a", events), ("b", events[:3])):
        sink = open_sink(tmp_path / f"{name}.aedat4", 10, 5)
        sink.write(some, end_of(some))
        sink.close()
    one, other = tmp_path / "a.aedat4", tmp_path / "b.aedat4"
    facts = json.loads(clsim("info", one, "--against", other, "--json").stdout)
    assert facts["statistics"]["active_share"] == 2 / 50 and facts["statistics"]["row_mates"] == pytest.approx(1 / 3)
    assert facts["against"]["events"] == 3 and facts["distances"]["row_mates"] == pytest.approx(1 / 6)
    assert "row_mates            0.333333" in clsim("info", one, "--statistics").stdout
    assert "statistics" not in told(clsim, one)
    for arguments, name in (
        (("two-boxes", "--statistics"), "two-boxes"),
        ((one, "--against", "two-boxes"), "--against"),
    ):
        refused = clsim("info", *arguments)
        assert refused.status == 2 and name in refused.stderr and "recording" in refused.stderr


@pytest.mark.parametrize("start_us", [0, 5_000_000])
def test_a_long_recording_begins_with_its_first_event(clsim, tmp_path, start_us):
    """It is read in portions."""
    events = np.zeros(40_000, EVENT_DTYPE)
    events["t"] = start_us + 100 * np.arange(len(events))
    events["x"][0], events["y"][1], events["on"][:10_000] = 19, 9, True
    sink = open_sink(tmp_path / "a.aedat4", 20, 10, flush=FlushPolicy(events=1000))
    sink.write(events, end_of(events))
    sink.close()
    facts = told(clsim, tmp_path / "a.aedat4")["events"]
    assert (facts["first_us"], facts["last_us"]) == (start_us, start_us + 3_999_900)
    assert facts["farthest_pixel"] == [19, 9] and facts["on_share"] == 0.25
    assert facts["duration_s"] == pytest.approx(3.9999) and facts["events_per_s"] == pytest.approx(40_000 / 3.9999)


def test_all_scenes_that_come_with_the_package_are_listed(clsim):
    lines = clsim("scenes").stdout.splitlines()
    assert [line.split()[0] for line in lines] == bundled_names()
