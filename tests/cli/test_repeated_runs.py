"""A run can be had again: from its sidecar, and from the frames that it would render."""

import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

from clsim import scenes
from clsim.cli.commands import render
from clsim.cli.commands.detect import detector_config
from clsim.cli.options.config import live_options
from clsim.detect.config import DetectorConfig
from clsim.errors import InputError
from clsim.events.outputs import FileOptions
from clsim.frames import Frame
from clsim.frames.exr import ExrWriter
from clsim.live.options import LiveOptions
from clsim.live.sensors import RecordedSensor
from clsim.sensor import load_sensor

SMALL = ("two-boxes", "--resolution", "32x24", "--fps", "60", "--frame-count", "7", "--threshold", "0.15,0.25")


@pytest.mark.parametrize(
    "options",
    [(), ("--quality", "draft"), ("--quality", "published", "--spp", "2"), ("--method", "esim-ad", "--spp", "2")],
    ids=lambda options: " ".join(options) or "balanced",
)
def test_rendered_and_detected_frames_give_the_events_of_the_live_run(
    clsim: Callable[..., object], tmp_path: Path, options: tuple[str, ...]
) -> None:
    live, detected = tmp_path / "live.txt", tmp_path / "detected.txt"
    assert clsim("live", *SMALL, *options, "--seed", "3", "--out", live).status == 0
    rendered = clsim("render", *SMALL, *options, "--seed", "3", "--out", tmp_path / "frames", "--json")
    assert json.loads(rendered.stdout) == {
        "frames": 7, "out": str(tmp_path / "frames"), "width": 32, "height": 24,
    }  # fmt: skip
    outcome = clsim("detect", tmp_path / "frames", "--out", detected)
    assert outcome.status == 0, outcome.stderr
    assert live.stat().st_size > 0 and detected.read_bytes() == live.read_bytes()


def test_what_is_traced_between_frames_stands_in_the_file_of_the_later_one(tmp_path: Path) -> None:
    """Before the first frame there is nothing."""
    frames = [(Frame(np.ones((3, 4, 6), np.float32), ("R", "G", "B"), 1000 * k, k), {"x": [k] * k}) for k in range(3)]
    each = [(frame, SimpleNamespace(as_dict=lambda traced=traced: traced)) for frame, traced in frames]
    rendering = SimpleNamespace(frames_and_requests=lambda: iter(each), frame_count=3, between=True)
    assert render._write_frames(rendering, ExrWriter(tmp_path), Console(stderr=True)) == 3  # type: ignore[arg-type]
    found = {file.name: np.load(file)["x"].tolist() for file in sorted(tmp_path.glob("*.npz"))}
    assert found == {"between-000001.npz": [1], "between-000002.npz": [2, 2]}
    assert len(list(tmp_path.glob("*.exr"))) == 3


def test_frames_tell_how_they_were_made(clsim: Callable[..., object], tmp_path: Path) -> None:
    """Every option, so that the same frames can be had again, and what a detector needs."""
    command = ("render", *SMALL, "--quality", "draft", "--seed", "7", "--max-depth", "3")
    assert clsim(*command, "--out", tmp_path / "a").status == 0
    about = json.loads((tmp_path / "a" / "frames.json").read_text())
    options = about["options"]
    assert set(options) >= set(LiveOptions.__dataclass_fields__)
    assert (options["seed"], options["fps"], options["resolution"]) == (7, 60.0, [32, 24])
    assert (options["max_depth"], options["spp"], options["first_hit_rays"]) == (3, 2, 8)
    assert about["fps"] == 60 and about["thresholds"] == {"on": 0.15, "off": 0.25}
    assert about["detector"]["method"] == "esim" and len(about["poses"]) == 7
    assert clsim("render", "--config", tmp_path / "a" / "frames.json", "--out", tmp_path / "b").status == 0
    for file in sorted((tmp_path / "a").glob("*.exr")):
        assert (tmp_path / "b" / file.name).read_bytes() == file.read_bytes()
    given = clsim("detect", tmp_path / "a", "--method", "esim", "--threshold", "0.3", "--out", tmp_path / "x.txt")
    assert given.status == 0
    detector = json.loads((tmp_path / "x.txt.json").read_text())["options"]["config"]
    assert (detector["method"], detector["window"], detector["threshold_on"]) == ("esim", None, 0.3)


def test_an_interrupted_rendering_tells_what_is_there(
    clsim: Callable[..., object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = ExrWriter.write

    def interrupted(self: ExrWriter, frame: Frame) -> Path:
        if frame.index == 2:
            raise KeyboardInterrupt
        return write(self, frame)

    monkeypatch.setattr(ExrWriter, "write", interrupted)
    outcome = clsim("render", *SMALL, "--quality", "draft", "--out", tmp_path / "frames")
    assert outcome.status == 130
    assert outcome.stderr == f"clsim: interrupted; {tmp_path / 'frames'} holds 2 of 7 frames\n"
    assert sorted(file.name for file in (tmp_path / "frames").iterdir()) == ["frame_0000.exr", "frame_0001.exr"]


def test_frames_tell_the_random_numbers_that_were_chosen(clsim: Callable[..., object], tmp_path: Path) -> None:
    """Not those of the quality, which are Sobol's. The kernel is one that others here have compiled."""
    file = tmp_path / "run.toml"
    file.write_text('sampler = "pcg"\n')
    command = ("render", *SMALL, "--quality", "exact", "--spp", "2", "--config", file)
    assert clsim(*command, "--out", tmp_path / "frames").status == 0
    assert json.loads((tmp_path / "frames" / "frames.json").read_text())["options"]["sampler"] == "pcg"


def test_a_render_prints_what_the_scene_will_not_get(clsim: Callable[..., object], tmp_path: Path) -> None:
    scene = tmp_path / "scene.xml"
    scene.write_text(
        '<scene version="3.0.0"><sensor type="perspective"/><emitter type="constant"/>'
        '<shape type="sphere"><bsdf type="roughdiffuse"/></shape></scene>'
    )
    said = {}
    for command in ("render", "live"):
        out = tmp_path / ("frames" if command == "render" else "a.txt")
        words = ("--method", "esim", "--spp", "1", "--resolution", "8x6", "--frame-count", "1", "--out", out)
        outcome = clsim(command, scene, *words)
        assert outcome.status == 0, outcome.stderr
        lines = [line for line in outcome.stderr.splitlines() if line.startswith("clsim: ")]
        said[command] = [line for line in lines if "kernels are compiled" not in line]  # said where it takes long
    assert said["render"] == said["live"] != []


def test_a_broken_frames_json_is_refused(clsim: Callable[..., object], tmp_path: Path) -> None:
    assert clsim("render", *SMALL[:-2], "--quality", "draft", "--out", tmp_path / "f").status == 0
    for text, sentence in (
        ("{", "frames.json: cannot be read"),
        ('{"detector": {"metod": "esim"}}', "did you mean 'method'"),
    ):
        (tmp_path / "f" / "frames.json").write_text(text)
        outcome = clsim("detect", tmp_path / "f", "--out", tmp_path / "x.txt")
        assert outcome.status == 2 and sentence in outcome.stderr
    (tmp_path / "f" / "frames.json").write_text("{}")
    assert clsim("detect", tmp_path / "f", "--method", "esim", "--out", tmp_path / "x.txt").status == 0


@pytest.mark.parametrize(
    "options",
    [
        ("--quality", "draft"),
        (),
        ("--quality", "published", "--spp", "2", "--duration", "60ms"),
        ("--loop", "--seed", "5"),
    ],
    ids=lambda options: " ".join(options) or "balanced",
)
def test_a_run_is_repeated_from_its_sidecar(
    clsim: Callable[..., object], tmp_path: Path, options: tuple[str, ...]
) -> None:
    size = SMALL[:5] if "--duration" in options else SMALL
    first, again = tmp_path / "events.aedat4", tmp_path / "again.aedat4"
    assert clsim("live", *size, *options, "--out", first).status == 0
    sidecar = tmp_path / "events.aedat4.json"
    before = sidecar.read_bytes(), first.read_bytes()
    outcome = clsim("live", "--config", sidecar, "--out", again)
    assert outcome.status == 0, outcome.stderr
    assert len(before[1]) > 1000 and again.read_bytes() == first.read_bytes()
    assert (sidecar.read_bytes(), first.read_bytes()) == before, "what is repeated must not be touched"
    told, retold = (json.loads(Path(f"{name}.json").read_text())["options"] for name in (first, again))
    assert retold.pop("outputs") == [str(again)] and told.pop("outputs") and retold == told


def config(tmp_path: Path, **options: object) -> Path:
    path = tmp_path / "config.json"
    path.write_text(json.dumps(options))
    return path


def test_options_given_win_over_the_file(tmp_path: Path) -> None:
    run = LiveOptions("cornell", quality="accurate", duration_s=1.0, seed=4, fps=30.0, outputs=("a.txt",))
    file = config(tmp_path, options=run.as_dict())
    again = live_options({"config": file, "outputs": ("b.h5",), "fps": 60.0})
    assert (again.scene, again.seed, again.fps, again.outputs) == ("cornell", 4, 60.0, ("b.h5",))
    assert again.point == run.point
    assert live_options({"config": file}).outputs == ()
    assert live_options({"config": file, "scene": "still"}).scene == "still"
    # A quality means all its settings, not those of the file; a number of frames means no duration.
    assert live_options({"config": file, "quality": "draft"}).point == LiveOptions("cornell", quality="draft").point
    assert live_options({"config": file, "frame_count": 3}).duration_s is None
    assert live_options({"config": file, "duration": "2s"}).duration_s == 2.0


def test_a_sensor_with_faults_takes_the_event_rule_that_it_can_have(tmp_path: Path) -> None:
    """What `clsim live` told of a run with the ideal sensor, and `clsim render` of its frames."""
    run = LiveOptions("cornell", quality="draft")
    file = config(tmp_path, options=run.as_dict())
    assert run.as_dict()["event_rule"] == "linear-light"
    assert live_options({"config": file, "sensor": "davis346"}).point.event_rule == "interpolated"
    assert live_options({"config": file, "sensor": "ideal"}).point.event_rule == "linear-light"
    asked = live_options({"config": file, "sensor": "davis346", "event_rule": "linear-light"})
    assert asked.point.event_rule == "linear-light"  # and is refused, since it was asked for
    seen = config(tmp_path, options=live_options({"config": file, "sensor": "davis346"}).as_dict())
    assert live_options({"config": seen, "sensor": "dvs128"}).point.event_rule == "interpolated"
    assert live_options({"config": seen, "sensor": "ideal"}).point.event_rule == "linear-light"

    told = {"detector": {"method": "irradiance", "event_rule": "linear-light"}}
    faulty, ideal = RecordedSensor(load_sensor("davis346")), RecordedSensor(load_sensor("ideal"))
    assert detector_config("frames", told, {}, faulty).event_rule == "interpolated"
    assert detector_config("frames", told, {"response": "lin-log"}).event_rule == "interpolated"
    assert detector_config("frames", told, {}, ideal).event_rule == "linear-light"
    assert detector_config("frames", told, {"event_rule": "linear-light"}, faulty).event_rule == "linear-light"


def test_another_method_has_its_own_window() -> None:
    """And not that of the one which frames.json tells."""
    told = {"detector": {"method": "esim-ad", "window": 9}}
    assert detector_config("frames", told, {"gate": "delta-r"}).side == 9
    assert detector_config("frames", told, {"method": "irradiance"}).side == DetectorConfig("irradiance").side == 7
    assert detector_config("frames", told, {"method": "irradiance", "window": 5}).side == 5


def test_a_file_by_hand_adds_to_what_is_given(tmp_path: Path) -> None:
    file = tmp_path / "run.toml"
    file.write_text('pose_rate = 100\nframe_rate = 10\nprobe_spp = 3\nring = "drop-oldest"\n[files]\nlabels = true\n')
    given = {
        "scene": "still",
        "truth": "depth",
        "quality": "accurate",
        "pace": "real",
        "outputs": ("a.h5", "b.parquet"),
    }
    with pytest.raises(InputError, match=r"^`labels` of outputs with `truth` are part of that"):
        live_options({"config": file, **given, "labels": True})
    run = live_options({"config": file, **given, "labels": False})
    assert (run.pose_rate, run.frame_rate, run.point.probe_spp, run.ring) == (100.0, 10.0, 3, "drop-oldest")
    assert run.quality == "accurate" and run.scene == "still"
    with pytest.raises(InputError, match=r"^`seed` must not be negative"):
        live_options({"config": file, **given, "labels": False, "seed": -1})
    with pytest.raises(InputError, match=r"^--config .*run.toml: `ring` drop-oldest needs `pace` real"):
        live_options({"config": file, "scene": "still", "truth": "depth"})
    file.write_text("pose_rate = = 100\n")
    with pytest.raises(InputError, match=r"^--config .*run.toml: is no TOML"):
        live_options({"config": file, **given})


def test_how_files_are_written_is_repeated_where_it_suits(tmp_path: Path) -> None:
    file = config(tmp_path, scene="still", files={"format": "evt2", "text_time": "s", "frames": True})
    assert live_options({"config": file, "outputs": ("a.txt",)}).files == FileOptions(text_time="s")
    assert live_options({"config": file, "outputs": ("a.aedat4",)}).files.frames
    assert not live_options({"config": file, "outputs": ("a.aedat4",), "frames": False}).files.frames


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (None, "cannot be read"),
        ("{", "is no JSON"),
        ("[]", "holds no options"),
        ('{"options": 3}', "holds no options"),
        ('{"scene": "still", "sppp": 3}', "did you mean 'spp'"),
        ('{"scene": "still", "spp": "8"}', "`spp` must be"),
        ('{"spp": 8}', "which scene"),
    ],
)
def test_files_that_hold_no_options(tmp_path: Path, text: str | None, sentence: str) -> None:
    path = tmp_path / "config.json"
    if text is not None:
        path.write_text(text)
    with pytest.raises(InputError, match=sentence):
        live_options({"config": path})


def test_a_scene_is_asked_for(clsim: Callable[..., object]) -> None:
    outcome = clsim("live")
    assert outcome.status == 2 and "which scene?" in outcome.stderr


def test_a_run_of_an_own_scene_is_repeated_from_any_folder_and_after_a_move(
    clsim: Callable[..., object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own, far = tmp_path / "own", tmp_path / "far"
    (own / "scenes").mkdir(parents=True)
    (own / "runs").mkdir()
    far.mkdir()
    (own / "scenes" / "mine.toml").write_bytes((Path(scenes.__file__).parent / "cornell.toml").read_bytes())
    monkeypatch.chdir(own)
    draft = ("--resolution", "16x12", "--frame-count", "4", "--fps", "20", "--quality", "draft")
    assert clsim("live", "scenes/mine.toml", *draft, "--out", "runs/a.txt").status == 0
    assert clsim("render", "scenes/mine.toml", *draft, "--out", "runs/frames").status == 0
    assert clsim("convert", "runs/a.txt", "converted.csv").status == 0
    events = Path("runs/a.txt").read_bytes()
    assert len(events) > 100
    monkeypatch.chdir(far)
    for place in (own, tmp_path / "moved"):
        if place != own:
            own.rename(place)
        for sidecar in ("runs/a.txt.json", "runs/frames/frames.json", "converted.csv.json"):
            outcome = clsim("live", "--config", place / sidecar, "--out", "again.txt")
            assert outcome.status == 0, outcome.stderr
            assert Path("again.txt").read_bytes() == events
    poses = json.loads((place / "converted.csv.json").read_text())["poses"]
    assert (place / poses).samefile(place / "runs" / "a.txt.poses.txt")
    (place / "scenes" / "mine.toml").unlink()
    outcome = clsim("live", "--config", place / "runs/a.txt.json", "--out", "again.txt")
    assert outcome.status == 2 and f"{own / 'scenes' / 'mine.toml'}: no such file" in outcome.stderr


@pytest.mark.parametrize(("before", "sensor"), [("ideal", "ideal"), ("dvs128", "davis346"), ("ideal", "davis346")])
@pytest.mark.parametrize("rule", ["frame", "interpolated"])
def test_a_rule_that_the_sensor_can_have_stays_the_files(tmp_path: Path, rule: str, before: str, sensor: str) -> None:
    """The file's run asked for it: another sensor, or the same one, is no reason to take the quality's."""
    run = LiveOptions("cornell", sensor=before, quality="draft", event_rule=rule)
    file = config(tmp_path, options=run.as_dict())
    assert live_options({"config": file, "sensor": sensor}).point.event_rule == rule


def test_a_run_with_truth_is_repeated_without_it(tmp_path: Path) -> None:
    """The rate of its frames goes with it; that of poses is of other files too, and is told."""
    run = LiveOptions("cornell", truth=("depth", "flow"), frame_rate=10.0)
    file = config(tmp_path, options=run.as_dict())
    assert live_options({"config": file}).frame_rate == 10.0
    again = live_options({"config": file, "truth": "none"})
    assert again.truth == () and again.frame_rate is None
