"""Each field of a run does something, and every way to say it leads there: options, keys of a file, and Python."""

import dataclasses
import inspect
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import clsim as library
from clsim.cli.spelling import CONFIG_KEYS, as_options
from clsim.errors import InputError
from clsim.live import rendering, session, stream
from clsim.live.options import LiveOptions
from clsim.simulator import driver
from tests.cli.options.run_rows import FIELDS, SCENE, write_files
from tests.cli.options.test_option_names import commands, options
from tests.contents import contents, differing

SAID_ONLY = ("about", "chosen", "notes", "silence", "warnings", "options", "more")
"""What tells of options, whether or not they do anything."""
NOT_SET = ("wall_start_s", "cpu_start_s", "started_s", "_threads", "_pending")
"""Clocks, what is numbered on and on, and memory that nothing was written to."""
FILE_OPTIONS: dict[str, tuple[str, Any]] = {
    "format": ("a", "evt2"),
    "text_time": ("a.txt", "s"),
    "ros_events": ("a.mcap", "evt3"),
    "frames": ("a.aedat4", True),
    "labels": ("a.h5", True),
}
"""Options of how files are written: an output that each is for, and a value."""
ABOUT_THE_COMMAND = {
    "--config": "reads the others: below, and test_repeated_runs.py",
    "--json": "test_live_settings.py",
    "--port": "test_view_commands.py",
    "--view": "test_view_commands.py",
}
"""What `clsim live` has beside the options of a run, and where it is tested."""


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Work in a folder with the files that rows name."""
    write_files(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run_of(fields: dict[str, Any]) -> LiveOptions:
    return LiveOptions.from_dict({"scene": SCENE} | fields)


def prepared(fields: dict[str, Any]) -> Any:
    """Return all that a run consists of before it starts, or why there is none."""
    there = {*Path().iterdir()}
    try:
        opened = session.open_live(run_of(fields))
    except InputError as error:
        return str(error)
    try:
        about = opened.about
        opened.about = {}
        opened.pipeline.watchers.remove(opened.silence)
        return contents(opened, (*SAID_ONLY, *NOT_SET)), about["camera"]
    finally:
        opened.pipeline.stop()
        remove_all_but(there)


def remove_all_but(there: set[Path]) -> None:
    """Remove what came into this folder, for a file that is there is replaced in another way."""
    for path in {*Path().iterdir()} - there:
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink()


def test_each_field_has_a_row() -> None:
    assert {*FIELDS} == {field.name for field in dataclasses.fields(LiveOptions)}


@pytest.mark.parametrize("name", FIELDS)
def test_a_field_changes_the_run(name: str, here: Path) -> None:
    row = FIELDS[name]
    before = prepared(row.beside)
    assert not differing(before, prepared(row.beside)), "a run is not like itself"
    assert isinstance(before[0], tuple), before
    assert differing(before, prepared(row.beside | {name: row.to})), "it changes nothing"


class Asked(Exception):
    """Somebody was asked to run what is in ``args``."""


@pytest.fixture
def asked(here: Path, monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Note the options that are asked for; nothing runs."""
    found: list[Any] = []

    def note(options: LiveOptions, *more: Any) -> None:
        found.extend([options, *more])
        raise InputError("enough")

    monkeypatch.setattr(session, "open_live", note)
    monkeypatch.setattr(rendering, "Rendering", note)
    return found


def typed(name: str, value: Any, folder: Path) -> list[str]:
    """Return how a field is typed: as an option, or as a key in a file."""
    option = as_options(f"`{name}`")
    if name == "scene":
        return [value]
    if name in CONFIG_KEYS:
        (folder / "keys.json").write_text(json.dumps({name: value}))
        return ["--config", "keys.json"]
    if name == "files":
        return [word for key, inner in value.items() for word in typed(key, inner, folder)]
    if name == "outputs":
        return [word for each in value for word in (option, each)]
    if name == "time_tolerance_us":
        return [option, f"{value:g}us"]
    if value is True:
        return [option]
    return [
        option,
        ("x" if name == "resolution" else ",").join(map(str, value)) if isinstance(value, tuple) else str(value),
    ]


def words_for(fields: dict[str, Any], folder: Path) -> list[str]:
    said = {"scene": SCENE} | fields
    return [word for name, value in said.items() for word in typed(name, value, folder)]


@pytest.mark.parametrize("name", FIELDS)
def test_what_is_typed_is_what_runs(name: str, clsim: Callable[..., Any], asked: list[Any], here: Path) -> None:
    row = FIELDS[name]
    fields = row.beside | {name: row.to}
    outcome = clsim("live", *words_for(fields, here), "--view", "none")
    assert asked == [run_of(fields)], outcome.stderr


@pytest.mark.parametrize("name", sorted(FIELDS.keys() - {"outputs", "files"}))
def test_a_key_of_a_file_is_what_runs(name: str, clsim: Callable[..., Any], asked: list[Any], here: Path) -> None:
    """Beside what is typed; where events go is never the file's, nor the format, which the new outputs tell."""
    row = FIELDS[name]
    fields = {"scene": SCENE} | row.beside | {name: row.to}
    outputs = {each: fields.pop(each) for each in ("outputs",) if each in fields}
    (here / "run.json").write_text(json.dumps(fields))
    written = [word for each, value in outputs.items() for word in typed(each, value, here)]
    outcome = clsim("live", "--config", "run.json", *written, "--view", "none")
    assert asked == [run_of(fields | outputs)], outcome.stderr


@pytest.mark.parametrize("name", FILE_OPTIONS)
def test_how_files_are_written_is_what_was_typed(
    name: str, clsim: Callable[..., Any], asked: list[Any], here: Path
) -> None:
    file, value = FILE_OPTIONS[name]
    outcome = clsim("live", *words_for({"outputs": (file,), "files": {name: value}}, here), "--view", "none")
    assert asked and getattr(asked[0].files, name) == value, outcome.stderr


def options_of(command: str) -> set[str]:
    return {option.opts[0] for option in options(commands()[(command,)])} - {"--help"}  # type: ignore[attr-defined]


def test_each_option_of_a_live_run_is_typed_above() -> None:
    said = {as_options(f"`{name}`") for name in FIELDS.keys() - CONFIG_KEYS - {"scene", "files"}}
    said |= {as_options(f"`{name}`") for name in FILE_OPTIONS}
    assert options_of("live") == said | {*ABOUT_THE_COMMAND}


@pytest.mark.parametrize("option", sorted(options_of("render") - {"--out", "--times", "--json", "--config"}))
def test_a_rendering_has_the_options_that_are_typed(
    option: str, clsim: Callable[..., Any], asked: list[Any], here: Path
) -> None:
    """--out, --json and --config are in test_repeated_runs.py."""
    name = next(name for name in FIELDS if as_options(f"`{name}`") == option)
    row = FIELDS[name]
    fields = {key: value for key, value in row.beside.items() if key != "outputs"} | {name: row.to}
    words = words_for({key: value for key, value in fields.items() if key != "time"}, here)
    times = ("--times", "adaptive") if "time" in fields else ()
    outcome = clsim("render", *words, *times, "--out", "frames")
    assert asked == [run_of(fields)], outcome.stderr


def test_a_rendering_is_of_the_times_that_are_given(clsim: Callable[..., Any], asked: list[Any], here: Path) -> None:
    (here / "times.txt").write_text("0\n0.01\n0.5\n")
    clsim("render", SCENE, "--times", "times.txt", "--out", "frames")
    assert asked == [run_of({"time": "fixed"}), [0, 10_000, 500_000]]


def test_each_argument_in_python_is_what_runs(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of `clsim.stream`, and of simulators, which know no outputs and no clock but their own."""

    def note(**given: Any) -> None:
        raise Asked(given)

    monkeypatch.setattr(stream, "LiveOptions", note)
    monkeypatch.setattr(driver, "LiveOptions", note)
    others = {library.stream: set(), library.Simulator: {"clock"}, library.RigSimulator: {"clock"}}
    for run, own in others.items():
        names = inspect.signature(run).parameters.keys() - own
        assert names == FIELDS.keys() if run is library.stream else names < FIELDS.keys()
        for name in names - {"scene"}:
            with pytest.raises(Asked) as plain:
                run(SCENE)
            with pytest.raises(Asked) as changed:
                run(SCENE, **{name: FIELDS[name].to})
            assert changed.value.args[0] == plain.value.args[0] | {name: FIELDS[name].to}, name


def test_each_argument_of_a_loaded_scene_changes_it(here: Path) -> None:
    assert inspect.signature(library.load_scene).parameters.keys() < FIELDS.keys()
    for name in inspect.signature(library.load_scene).parameters.keys() - {"strict"}:
        before = {"scene": SCENE} | FIELDS[name].beside
        changed = before | {name: FIELDS[name].to}
        assert contents(library.load_scene(**before)) != contents(library.load_scene(**changed)), name
    assert library.load_scene("lacks.xml").warnings
    with pytest.raises(InputError, match="refused by strict"):
        library.load_scene("lacks.xml", strict=True)
