"""Who imports whom: rooms of the package, and the files in its root. Imports go one way, and folders are small."""

import ast
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "clsim"
MOST_FILES = 15
_DRIVEN = (
    "detect", "detector", "errors", "events", "forks", "frames", "opencl", "render", "scene", "sensor", "truth",
    "values", "version",
)  # fmt: skip
ALLOWED = {
    "errors": (),
    "version": (),
    "values": ("errors",),
    "caches": ("errors",),
    "forks": ("errors",),
    "frames": ("errors", "version"),
    "scene": ("errors", "frames", "values"),
    "opencl": ("caches", "errors", "forks", "version"),
    "events": ("errors", "frames", "values", "version"),
    "footage": ("errors", "frames"),
    "render": ("caches", "errors", "forks", "frames", "scene"),
    "detect": ("errors", "events", "frames", "opencl", "values"),
    "sensor": ("errors", "events", "opencl", "scene", "values"),
    "detector": ("detect", "errors", "events", "frames", "opencl", "sensor"),
    "truth": ("errors", "events", "frames", "scene", "values", "version"),
    "score": ("errors", "events"),
    "live": (*_DRIVEN, "footage"),
    "simulator": (*_DRIVEN, "live"),
    "bridges": ("errors", "events", "scene", "simulator", "values"),
    "datasets": ("caches", "errors", "events", "live", "scene", "values", "version"),
    "__init__": ("errors", "events", "live", "scene", "simulator", "version"),
    "bench": ("__init__", *_DRIVEN, "live", "score", "simulator"),
    "cli": ("__init__", "bench", "caches", "datasets", *_DRIVEN, "footage", "live", "score"),
    "__main__": ("cli",),
}
"""What each room, and each file in the root, may import beyond itself; a room's name says nothing of its order."""
EXCEPTIONS = {("clsim.events.files", "clsim.truth.recording")}
"""A folder with truth is opened as events are, and is read in the room above, which is asked when there is one."""
PLAIN_DATA = {"clsim.detect.config", "clsim.detect.stats"}
"""All that detection in float64 shares with the kernels' host code."""


@cache
def modules() -> dict[str, Path]:
    """Return the files of the package by their dotted names; those of packages end in ``.__init__``."""
    files = [file for file in PACKAGE.rglob("*.py") if not {"kernels", "scenes"} & {*file.relative_to(PACKAGE).parts}]
    assert len(files) > 500
    return {".".join(file.relative_to(ROOT).with_suffix("").parts): file for file in files}


@cache
def imported(module: str) -> frozenset[str]:
    """Return the modules that one imports, anywhere in its file, by name and not by a string."""
    found = set()
    for node in ast.walk(ast.parse(modules()[module].read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            assert node.module and not node.level, module
            found |= {f"{node.module}.{name.name}" for name in node.names}
        elif isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
    return frozenset(_module(name) for name in found if name.split(".")[0] == "clsim")


def _module(name: str) -> str:
    while name not in modules():
        if f"{name}.__init__" in modules():
            return f"{name}.__init__"
        name = name.rpartition(".")[0]
    return name


def room(module: str) -> str:
    """Return the folder of a module; a file beside folders is a room of its own."""
    folder = modules()[module].parent
    return module if any(folder.glob("*/__init__.py")) else module.rpartition(".")[0]


def test_imports_between_rooms_go_one_way() -> None:
    rooms: dict[str, set[str]] = {}
    for module in modules():
        targets = {room(name) for name in imported(module) if (module, name) not in EXCEPTIONS}
        rooms.setdefault(room(module), set()).update(targets - {room(module)})
    assert len(rooms) > 100
    TopologicalSorter(rooms).prepare()  # raises CycleError with the rooms of a circle


def test_a_room_imports_nothing_from_above() -> None:
    assert {module.split(".")[1] for module in modules()} == {*ALLOWED}
    for module in modules():
        own = module.split(".")[1]
        for name in imported(module):
            other = name.split(".")[1]
            assert other in (own, *ALLOWED[own]) or (module, name) in EXCEPTIONS, f"{module} imports {name}"


def test_exceptions_are_needed() -> None:
    assert all(name in imported(module) for module, name in EXCEPTIONS)


@pytest.mark.parametrize("oracle", ["detect.float64", "detect.reference", "sensor.reference"])
def test_float64_and_the_host_code_of_kernels_do_not_know_each_other(oracle: str) -> None:
    own = [module for module in modules() if module.startswith(f"clsim.{oracle}.")]
    assert own
    below = (f"clsim.{oracle}.", *(["clsim.detect.float64."] if oracle == "detect.reference" else []))
    for module in own:
        names = {name for name in imported(module) if name.startswith(("clsim.detect", "clsim.opencl", "clsim.sensor"))}
        assert {name for name in names if not name.startswith(below)} <= PLAIN_DATA, module
    for module in modules():
        if module.startswith(("clsim.detect.", "clsim.opencl.", "clsim.sensor.")) and module not in own:
            names = {name for name in imported(module) if name.startswith(f"clsim.{oracle}.")}
            assert not names or module.startswith("clsim.detect.reference."), module


@pytest.mark.parametrize("oracle", ["detect.reference", "sensor.reference"])
def test_nothing_that_runs_imports_an_oracle(oracle: str) -> None:
    for module in modules():
        if not module.startswith(f"clsim.{oracle}."):
            assert not any(name.startswith(f"clsim.{oracle}.") for name in imported(module)), module


@pytest.mark.parametrize(("top", "least"), [("clsim", 50), ("kernels", 3), ("tests", 30), ("tools", 5)])
def test_no_folder_has_many_files(top: str, least: int) -> None:
    folders = {file.parent for file in (ROOT / top).rglob("*") if file.suffix in (".py", ".cl", ".clh", ".h")}
    counts = {folder: sum(file.is_file() for file in folder.iterdir()) for folder in folders}
    assert len(counts) >= least
    assert not {str(folder): count for folder, count in counts.items() if count > MOST_FILES}
