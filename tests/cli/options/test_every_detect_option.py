"""Each option of `clsim detect` changes what detects, in frames and in pictures, and wins over a sidecar's."""

import inspect
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import clsim
from clsim.cli.output import status
from clsim.errors import InputError
from clsim.frames import BASE_PLANES, Frame
from clsim.frames.exr import ExrWriter
from clsim.live import footage
from tests.cli.options.test_every_run_option import NOT_SET, remove_all_but
from tests.cli.options.test_option_names import commands, options
from tests.contents import contents, differing

ROWS: dict[str, tuple[str, str]] = {
    "--out": ("", "--out b.txt"),
    "--fps": ("", "--fps 50"),
    "--threshold": ("", "--threshold 0.3,0.4"),
    "--sensor": ("", "--sensor davis346"),
    "--seed": ("--sensor davis346", "--seed 4"),
    "--lux-per-unit": ("--sensor davis346", "--lux-per-unit 7"),
    "--transfer": ("", "--transfer linear"),
    "--times": ("", "--times times.txt"),
    "--time-unit": ("--times times.txt", "--time-unit ms"),
    "--like": ("", "--like v2e"),
    "--method": ("", "--method wlr-esim"),
    "--gate": ("--method esim-ad", "--gate delta-r"),
    "--gate-scale": ("--method esim-ad", "--gate-scale 2"),
    "--box": ("--method esim-ad", "--box 7"),
    "--event-rule": ("", "--event-rule frame"),
    "--window": ("--method esim-ad", "--window 7"),
    "--stride": ("--method esim-ad", "--stride 2"),
    "--history": ("--method esim-ad", "--history 2"),
    "--confidence": ("--method irradiance", "--confidence 2"),
    "--kernel": ("--method esim-ad", "--kernel epanechnikov"),
    "--bandwidth": ("--method esim-ad", "--bandwidth tsvd"),
    "--bandwidth-h": ("--method esim-ad", "--bandwidth-h 2"),
    "--ridge": ("--method esim-ad", "--ridge 0.1"),
    "--regress": ("--method esim-ad", "--regress linear"),
    "--shrink": ("--method esim-ad --regress linear", "--shrink 1.5"),
    "--response": ("", "--response lin-log"),
    "--luminance": ("", "--luminance rec601"),
    "--scale": ("", "--scale 3"),
    "--floor": ("", "--floor 0.01"),
    "--features": ("--method esim-ad", "--features Depth,Albedo.R"),
    "--precision": ("--method esim-ad", "--precision float64"),
    "--opencl": ("", "--opencl nothing-like-it"),
    "--format": ("", "--out plain --format evt2"),
    "--text-time": ("", "--text-time s"),
    "--labels": ("--out a.h5", "--labels"),
    "--ros-events": ("--out a.mcap", "--ros-events evt3"),
}
"""What is typed before, and what is then typed too."""
ELSEWHERE = {
    "--config": "another way to say all that: below",
    "--json": "what is printed of any run: test_live_settings.py",
}
STAYS: dict[str, set[str]] = {
    "--sensor": {"threshold_on", "threshold_off", "floor", "method"},
    "--threshold": {"floor"},
    "--transfer": {"floor"},
    "--response": {"floor"},
    "--scale": {"floor"},
}
"""What a sidecar tells as it was in the end, chosen or not, and so stays as it is where these are given beside it."""
OF_PICTURES = ("--transfer", "--times", "--time-unit", "--like")
OF_BOTH = ("--out", "--fps", "--threshold", "--sensor", "--seed", "--lux-per-unit", "--scale", "--opencl", "--labels")
"""What is not handed on by the same lines for frames and for pictures, as what is the detector's alone is."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with frames, pictures, and their times."""
    path = tmp_path_factory.mktemp("detect")
    writer = ExrWriter(path / "frames")
    (path / "pictures").mkdir()
    for k in range(2):
        planes = np.full((len(BASE_PLANES), 12, 16), 0.2 + 0.1 * k, np.float32)
        writer.write(Frame(planes, BASE_PLANES, 10_000 * k, k))
        Image.fromarray(np.full((12, 16, 3), 50 + 50 * k, np.uint8)).save(path / f"pictures/{k}.png")
    (path / "times.txt").write_text("0\n0.5\n")
    return path


@pytest.fixture
def session(folder: Path, monkeypatch: pytest.MonkeyPatch, clsim: Callable[..., Any]) -> Callable[..., Any]:
    """Return what detects, and what a sidecar would tell of it, as it is typed; or why nothing does."""
    monkeypatch.chdir(folder)
    found: list[Any] = []

    def keep(session: Any, **_: Any) -> int:
        found.append(session)
        raise InputError("enough")

    monkeypatch.setattr(status, "run_session", keep)

    def opened(*words: str) -> tuple[Any, dict[str, Any]]:
        found.clear()
        there = {*Path().iterdir()}
        outcome = clsim("detect", *words)
        if not found:
            return outcome.stderr, {}
        try:
            about, found[0].about = found[0].about, {}
            found[0].pipeline.watchers.remove(found[0].silence)
            return contents(found[0], ("silence", *NOT_SET)), about
        finally:
            found[0].pipeline.stop()
            remove_all_but(there)

    return opened


def of(frames: str, words: str) -> list[str]:
    return [str(Path(frames).absolute()), *words.split(), *([] if "--out" in words else ["--out", "a.txt"])]


def rate(frames: str, words: str) -> str:
    return words if frames == "frames" or "--fps" in words or "--times" in words else f"{words} --fps 30"


def test_each_option_is_typed() -> None:
    assert {option.opts[0] for option in options(commands()[("detect",)])} - {"--help"} == {*ROWS, *ELSEWHERE}  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("option", "frames"),
    [(option, "frames") for option in ROWS] + [(option, "pictures") for option in (*OF_PICTURES, *OF_BOTH)],
)
def test_an_option_changes_what_detects_beside_a_sidecar_too(
    option: str, frames: str, session: Callable[..., Any]
) -> None:
    before, more = ROWS[option]
    plain, about = session(*of(frames, rate(frames, before)))
    said = rate(frames, f"{before} {more}")
    changed, _ = session(*of(frames, said))
    if frames == "frames" and option in OF_PICTURES:
        assert re.search("--[a-z-]+ is for video and pictures", changed)
        return
    assert differing(changed, plain), "it changes nothing"
    Path("told.json").write_text(json.dumps(about, default=str))
    outputs = before if "--out" in before else ""
    again, _ = session("--config", "told.json", *of(frames, f"{outputs} {more}")[1:])
    lost = {place.partition(":")[0].rpartition(".")[2]: place for place in differing(again, changed)}
    assert lost.keys() <= STAYS.get(option, set()), lost


def test_a_rate_takes_the_place_of_times_that_a_sidecar_tells(session: Callable[..., Any]) -> None:
    _, about = session(*of("pictures", "--times times.txt"))
    Path("told.json").write_text(json.dumps(about, default=str))
    again, _ = session("--config", "told.json", "--fps", "50", "--out", "a.txt")
    assert not differing(again, session(*of("pictures", "--fps 50"))[0])


def test_each_argument_in_python_changes_what_detects(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    monkeypatch.setattr(footage, "_run", lambda *run: contents(run))
    rows: dict[str, tuple[dict[str, Any], Any]] = {
        "frames": ({}, [np.zeros((12, 16), np.uint8)] * 2),
        "times_us": ({"fps": None}, [0, 500]),
        "fps": ({}, 50.0),
        "transfer": ({}, "linear"),
        "like": ({}, "v2e"),
        "opencl": ({}, "no such device"),
        "sensor": ({}, "davis346"),
        "seed": ({"sensor": "davis346"}, 3),
        "lux_per_unit": ({"sensor": "davis346"}, 7.0),
        "detector": ({}, {"threshold_on": 0.3}),
    }
    assert {*rows} == {*inspect.signature(clsim.events_from).parameters}
    for name, (beside, value) in rows.items():
        given = {"frames": "pictures", "fps": 30.0} | beside
        changed = given | (value if name == "detector" else {name: value})
        if given["fps"] is None:
            given["times_us"] = [0, 1000]
        if name == "opencl":
            with pytest.raises(clsim.InputError, match="no such device"):
                clsim.events_from(**changed)
            continue
        assert differing(clsim.events_from(**given), clsim.events_from(**changed)), name
