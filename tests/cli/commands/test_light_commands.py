"""Commands that need neither Warp nor OpenCL do not wait for them."""

import subprocess
import sys
from pathlib import Path

import pytest

HEAVY = ("warp", "pyopencl", "scipy", "matplotlib", "trimesh")
RUN = f"""
import atexit, sys
atexit.register(lambda: print("imported", [name for name in {HEAVY} if name in sys.modules]))
from clsim.cli import main
main()
"""


def imported(folder: Path, *arguments: str) -> str:
    """Return what a command has imported, of what takes long."""
    command = [sys.executable, "-c", RUN, *arguments]
    run = subprocess.run(command, capture_output=True, text=True, cwd=folder, check=True)
    return run.stdout.splitlines()[-1]


@pytest.mark.parametrize("arguments", [("--help",), ("--version",), ("live", "--help"), ("scenes",)])
def test_help_imports_nothing_heavy(tmp_path: Path, arguments: tuple[str, ...]) -> None:
    assert imported(tmp_path, *arguments) == "imported []"


def test_convert_imports_nothing_heavy(tmp_path: Path) -> None:
    (tmp_path / "events.csv").write_text("t,x,y,p\n1,2,3,1\n5,2,4,0\n")
    for target in ("events.npz", "events.aedat4", "events.h5"):
        assert imported(tmp_path, "convert", "events.csv", target) == "imported []"


def test_what_renders_imports_what_it_needs(tmp_path: Path) -> None:
    assert imported(tmp_path, "devices") == "imported ['warp', 'pyopencl']"
