"""Programs whose home cannot be written, as in a container with --user."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

CACHES = ("XDG_CACHE_HOME", "WARP_CACHE_PATH", "POCL_CACHE_DIR", "PYOPENCL_CACHE_DIR")


def run(tmp_path: Path, own: tuple[str, ...], *arguments: str) -> tuple[str, list[str]]:
    """Return what is printed, and what is said on standard error, but for that kernels are compiled."""
    (tmp_path / "file").write_text("no folder")
    about = {name: value for name, value in os.environ.items() if name not in CACHES}
    about |= {"HOME": str(tmp_path / "file" / "home"), "TMPDIR": str(tmp_path)}
    about |= {name: str(tmp_path / name) for name in own}
    ended = subprocess.run([sys.executable, "-m", "clsim", *arguments], env=about, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr
    return ended.stdout, [line for line in ended.stderr.splitlines() if "starting (new kernels" not in line]


@pytest.mark.parametrize("own", [(), ("WARP_CACHE_PATH", "POCL_CACHE_DIR")])
def test_devices_are_found_and_kernels_are_kept_elsewhere(tmp_path: Path, own: tuple[str, ...]) -> None:
    printed, said = run(tmp_path, own, "devices")
    assert "    works" in printed
    assert len(said) == 1 and "XDG_CACHE_HOME" in said[0] and str(tmp_path / "clsim-cache-") in said[0], said


@pytest.mark.slow
def test_a_run_goes_as_ever(tmp_path: Path) -> None:
    printed, said = run(tmp_path, (), "live", "still", "--frame-count", "2", "--resolution", "32x24", "--json")
    assert '"frames": 2' in printed and len(said) == 1, said
