"""Each option of the commands that neither run nor detect changes something that its user gets.

What takes long or needs a screen is a stand-in that tells what it was asked for.
"""

import shutil
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from clsim.bench import edge
from clsim.bench.throughput import detect, render, scene
from clsim.bench.tradeoff import sweep
from clsim.cli.commands import bench_tradeoff
from clsim.cli.commands import view as view_command
from clsim.cli.output import sensor_fits, tradeoff_tables
from clsim.cli.plots import sensor_plot, tradeoff_plot
from clsim.datasets import engine, preview, shards
from clsim.errors import InputError
from clsim.events.files import open_sink
from clsim.live.view import player, rerun
from clsim.opencl import device
from clsim.truth.layouts import open_layout
from tests.cli.options.test_option_names import commands, options
from tests.live.view.view_events import random_events
from tests.truth.recordings import about, feed

Rows = dict[str, tuple[str, str]]
EVENTS = random_events(300, 20, 10)
SCORE = "score a.txt b.txt --resolution 20x10 --fps 60"
FILM, PICTURE, PAGE = "view a.txt --to out/a.gif", "view a.txt --to out/a.png", "view a.txt"
FIT = "sensor fit a.txt --out out/mine.toml"
SET, EDGE, TRADE = "dataset flow --out out", "bench edge", "bench tradeoff still --cache cache"
ROWS: dict[str, Rows] = {
    "convert": {
        "--resolution": ("convert a.txt out/a.aedat4", "--resolution 30x20"),
        "--format": ("convert a.txt out/a.raw", "--format evt3"),
        "--text-time": ("convert a.txt out/b.txt", "--text-time s"),
        "--ros-events": ("convert a.txt out/a.mcap", "--ros-events evt3"),
        "--strict": ("convert late.txt out/b.txt", "--strict"),
    },
    "score": {
        "--resolution": (SCORE, "--resolution 40x20"),
        "--fps": (SCORE, "--fps 1000"),
        "--tau": (SCORE, "--tau 0.05"),
        "--within": (SCORE, "--within 40ms"),
        "--plot": (SCORE, "--plot out/a.png"),
        "--json": (SCORE, "--json"),
        "--strict": ("score a.txt late.txt --resolution 20x10 --fps 60", "--strict"),
    },
    "info": {
        "--statistics": ("info a.txt", "--statistics"),
        "--against": ("info a.txt --statistics", "--against b.txt"),
        "--json": ("info a.txt", "--json"),
        "--strict": ("info late.txt", "--strict"),
    },
    "view": {
        "--view": (PAGE, "--view terminal"),
        "--port": (PAGE, "--port 1234"),
        "--to": (PAGE, "--to out/a.png"),
        "--accumulate": (FILM, "--accumulate 5ms"),
        "--decay": (FILM, "--decay"),
        "--contrast": (PICTURE, "--contrast 9"),
        "--colours": (PICTURE, "--colours grey"),
        "--theme": (PICTURE, "--theme light"),
        "--zoom": (PICTURE, "--zoom 1"),
        "--video-fps": (FILM, "--video-fps 10"),
        "--speed": (FILM, "--speed 0.5"),
        "--at": (PICTURE, "--at 0.1s"),
        "--show": ("view truth.h5", "--show depth"),
        "--resolution": (PICTURE, "--resolution 30x20"),
        "--strict": ("view late.txt --to out/a.png", "--strict"),
    },
    "view page": {
        "--colours": ("view a.h5", "--colours grey"),
        "--resolution": (PAGE, "--resolution 30x20"),
        "--strict": ("view late.txt", "--strict"),
    },
    "view terminal": {
        "--speed": (f"{PAGE} --view terminal", "--speed 0.5"),
        "--strict": ("view late.txt --view terminal", "--strict"),
        "--resolution": (f"{PAGE} --view rerun", "--resolution 30x20"),
    },
    "dataset": {
        "--out": (SET, "--out out/other"),
        "--count": (SET, "--count 3"),
        "--workers": (SET, "--workers 3"),
        "--scheduler": (SET, "--scheduler tcp://a:1"),
        "--dry-run": (SET, "--dry-run"),
        "--shards": (SET, "--shards parquet"),
        "--verify": (SET, "--verify"),
        "--json": (SET, "--json"),
    },
    "dataset ahead": {
        "--out": (f"{SET} --dry-run", "--out out/other"),
        "--count": (f"{SET} --dry-run", "--count 3"),
        "--workers": (f"{SET} --dry-run", "--workers 3"),
        "--json": (f"{SET} --dry-run", "--json"),
    },
    "bench throughput": {
        "--scene": ("bench throughput", "--scene still"),
        "--json": ("bench throughput", "--json"),
        "--opencl": ("bench throughput", "--opencl mine"),
    },
    "bench edge": {
        "--resolution": (EDGE, "--resolution 32x24"),
        "--fps": (EDGE, "--fps 480"),
        "--time": (EDGE, "--time fixed"),
        "--json": (EDGE, "--json"),
    },
    "bench tradeoff": {
        "--quick": (TRADE, "--quick"),
        "--csv": (TRADE, "--csv out/a.csv"),
        "--plot": (TRADE, "--plot out/a.png"),
        "--markdown": (TRADE, "--markdown out/a.md"),
        "--reference-spp": (TRADE, "--reference-spp 16"),
        "--reference-budget": (TRADE, "--reference-budget 3"),
        "--resolution": (TRADE, "--resolution 16x12"),
        "--frame-count": (TRADE, "--frame-count 4"),
        "--fps": (TRADE, "--fps 20"),
        "--seeds": (TRADE, "--seeds 1,2"),
        "--cache": (TRADE, "--cache other"),
        "--json": (TRADE, "--json"),
    },
    "sensor plot": {
        "--out": ("sensor plot davis346 --out out/a.png", "--out out/b.png"),
        "--seed": ("sensor plot davis346 --out out/a.png", "--seed 3"),
    },
    "sensor fit": {
        "--out": (FIT, "--out out/other.toml"),
        "--lamp": (f"{FIT} --lamp b.txt --contrast 0.5", "--lamp a.txt"),
        "--contrast": (f"{FIT} --lamp b.txt --contrast 0.5", "--contrast 0.6"),
        "--base": (FIT, "--base davis346"),
        "--lux": (FIT, "--lux 100"),
        "--check": (FIT, "--check"),
        "--resolution": (FIT, "--resolution 30x20"),
        "--json": (FIT, "--json"),
    },
    "sensor fit in several lights": {
        "--base": (f"{FIT} --lux 100", "--base davis346"),
        "--resolution": (f"{FIT} --lux 100", "--resolution 30x20"),
        "--out": (f"{FIT} --lux 100", "--out out/other.toml"),
    },
    "scenes": {"--json": ("scenes", "--json")},
    "devices": {"--json": ("devices", "--json")},
}
"""By commands, and by what else of them there is: what is typed before, and what is typed then too."""
ELSEWHERE = ("live", "render", "detect")
"""In test_every_run_option.py and test_every_detect_option.py."""


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with recordings."""
    folder = tmp_path_factory.mktemp("commands")
    for name, events in {"a": EVENTS, "b": random_events(300, 20, 10, seed=1)}.items():
        for ending in ("txt", "h5"):
            sink = open_sink(folder / f"{name}.{ending}", 20, 10)
            sink.write(events, int(events["t"][-1]) + 1)
            sink.close()
    (folder / "late.txt").write_text("100 1 1 1\n50 2 2 0\n200 3 3 1\n")
    feed(open_layout(str(folder / "truth.h5"), about()))
    return folder


@pytest.fixture(scope="module")
def known() -> dict[str, Any]:
    """Return what a command gives without an option, by what is typed."""
    return {}


@pytest.fixture
def stand_ins(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let what takes long, or a screen, print what it is asked for."""

    def stand_in(where: Any, name: str, result: Any = None) -> None:
        def told(*given: Any, **named: Any) -> Any:
            print(name, *(each for each in given if not callable(each)), {**named, "tell": None})
            if isinstance(result, Path):
                Path(given[-1]).write_text(name)
            return result

        monkeypatch.setattr(where, name, told)

    done = engine.Progress(2, whole=2)
    ahead = preview.Preview("sheet", 1, 1.0, 1.0, 1.0, 0, ())
    measured = SimpleNamespace(world=SimpleNamespace(notes=(), warnings=()), run=dict)
    for where, name, result in (
        (engine, "make", done), (preview, "preview", ahead), (shards, "write_shards", [Path("out/a")]),
        (device, "choose_device", "device"), (detect, "detect_throughput", {"a": 1}),
        (render, "render_throughput", {"b": 2}), (scene, "scene_throughput", {"c": 3}), (edge, "measure_edges", []),
        (sweep, "Sweep", measured), (bench_tradeoff, "_print_front", None), (tradeoff_tables, "csv_text", "csv"),
        (tradeoff_tables, "markdown_text", "markdown"), (tradeoff_plot, "plot_tradeoff", Path()),
        (sensor_plot, "plot_sensors", None), (sensor_fits, "fit_scenes", ("text", [])),
        (sensor_fits, "fit_lights", ("text", [])), (sensor_fits, "predict", []), (sensor_fits, "tell", None),
        (view_command, "check", None), (rerun, "RerunSink", None),
    ):  # fmt: skip
        stand_in(where, name, result)
    monkeypatch.setattr(view_command, "_in_terminal", lambda name, source, *more: print(name, read(source), *more))
    monkeypatch.setattr(view_command, "_pump", lambda source, sink: print(read(source)))
    monkeypatch.setattr(player, "Player", Page)


def read(source: Any) -> Any:
    try:
        return sum(map(len, source))
    except InputError as error:
        return str(error)


class Page:
    """Tells what a page of the browser is given to show, and is left at once."""

    warning, url = None, "http://here"

    def __init__(self, opened: Callable[[], Any], *more: Any, read_frames: Any, **named: Any) -> None:
        shown = None if read_frames is None else [each[1].tobytes()[:50] for each in read_frames()]
        print(read(opened()), more, sorted(named.items()), shown)

    def wait(self, seconds: float) -> None:
        raise KeyboardInterrupt

    def close(self) -> None:
        pass


def test_each_option_of_each_command_has_a_row() -> None:
    for words, command in commands().items():
        if words[0] not in ELSEWHERE:
            named = {option.opts[0] for option in options(command)} - {"--help"}  # type: ignore[attr-defined]
            assert named == {*ROWS[" ".join(words)]}, words


@pytest.mark.parametrize(("command", "option"), [(command, option) for command in ROWS for option in ROWS[command]])
def test_an_option_changes_what_its_user_gets(
    command: str, option: str, clsim: Callable[..., Any], recordings: Path, known: dict[str, Any], stand_ins: None,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(recordings)
    before, more = ROWS[command][option]

    def got(words: str) -> Any:
        folder = recordings / "out"
        folder.mkdir()
        outcome = clsim(*words.split())
        texts = [(path.name, path.read_bytes()) for path in sorted(folder.rglob("*")) if path.is_file()]
        shutil.rmtree(folder)
        return outcome, texts

    if before not in known:
        known[before] = got(before)
        assert known[before] == got(before), "it does not do the same again"
    plain, changed = known[before], got(f"{before} {more}")
    assert plain[0].status in (0, 130), plain[0].stderr
    assert changed != plain, "it changes nothing"
    assert option == "--strict" or changed[0].status in (0, 130), changed[0].stderr


@pytest.mark.parametrize("shown", ["depth", "flow", "ids"])
def test_a_page_shows_and_names_what_is_asked_for(
    shown: str, clsim: Callable[..., Any], recordings: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = []

    def page(*_: Any, read_frames: Any, frames_are: str, **__: Any) -> None:
        found.append((frames_are, [each[1].tobytes() for each in read_frames()]))
        raise InputError("enough")

    monkeypatch.setattr(player, "Player", page)
    for arguments in ((), ("--show", shown)):
        clsim("view", recordings / "truth.h5", *arguments)
    (image, images), (other, others) = found
    assert image != other and images != others
