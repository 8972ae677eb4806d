"""Who imports whom, in the rooms of frames, OpenCL, detection and sensor."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "clsim"
COMMON = {"clsim.errors", "clsim.values", "clsim.version", "clsim.frames", "clsim.events"}
ALLOWED = {
    "frames": {"clsim.errors", "clsim.version", "clsim.frames"},
    "opencl": {"clsim.caches", "clsim.errors", "clsim.forks", "clsim.version", "clsim.opencl"},
    "sensor": COMMON | {"clsim.opencl", "clsim.scene", "clsim.sensor"},
    "detect": COMMON | {"clsim.opencl", "clsim.detect"},
}
PLAIN_DATA = {"clsim.detect.config", "clsim.detect.stats"}
"""All that the oracle shares with the kernels' host code."""


def imported(file: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module)
        elif isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
    return {name for name in found if name.split(".")[0] == "clsim"}


@pytest.mark.parametrize("room", ALLOWED)
def test_a_room_imports_nothing_from_above(room: str) -> None:
    files = list((PACKAGE / room).rglob("*.py"))
    assert files
    for file in files:
        for module in imported(file):
            assert any(module == one or module.startswith(f"{one}.") for one in ALLOWED[room]), f"{file}: {module}"


@pytest.mark.parametrize("room", ["detect", "sensor"])
def test_the_oracle_and_the_host_code_do_not_know_each_other(room: str) -> None:
    oracle = PACKAGE / room / "reference"
    assert list(oracle.rglob("*.py"))
    for file in oracle.rglob("*.py"):
        own = {
            module for module in imported(file) if module.startswith(("clsim.detect", "clsim.opencl", "clsim.sensor"))
        }
        assert {module for module in own if not module.startswith(f"clsim.{room}.reference")} <= PLAIN_DATA, file
    for host in ("detect", "opencl", "sensor"):
        for file in set((PACKAGE / host).rglob("*.py")) - set(oracle.rglob("*.py")):
            assert not any(module.startswith(f"clsim.{room}.reference") for module in imported(file)), file
