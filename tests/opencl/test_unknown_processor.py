"""A machine whose processor PoCL does not know: every program below is made to run on one."""

import os
import subprocess
import sys
from pathlib import Path

import pyopencl as cl
import pytest

from clsim.opencl.trial import POCL

ROOT = Path(__file__).parents[2]
FOLDER = Path(__file__).with_name("unknown_processor")
ORACLES = ("tests/sensor/test_math.py", "tests/sensor/test_ideal.py", "tests/detect/float64/test_reference_gate.py")

pytestmark = pytest.mark.skipif(
    not any(POCL in platform.name and "x86_64" in platform.get_devices()[0].version for platform in cl.get_platforms()),
    reason="there is no PoCL for x86-64 here",
)


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run Python in such a child."""
    about = os.environ | {"PYTHONPATH": f"{FOLDER}{os.pathsep}{ROOT}"}
    return subprocess.run([sys.executable, *arguments], env=about, capture_output=True, text=True, cwd=ROOT)


BUILD = """
import pyopencl as cl
device = next(p for p in cl.get_platforms() if "Portable" in p.name).get_devices()[0]
cl.Program(cl.Context([device]), "kernel void k(global float *x) { *x = 1; }").build()
"""
WITHOUT_NAMES = f"""
import sys
import clsim.opencl.processor
from clsim.cli import main
clsim.opencl.processor.known_name = lambda features: None
sys.argv = ["clsim", "live", "still", "--json", "--opencl", {POCL!r}]
main()
"""


def test_nothing_can_be_built_there() -> None:
    assert "unknown target CPU 'generic'" in run("-c", BUILD).stderr


def test_clsim_builds_for_the_nearest_that_is_known() -> None:
    told = run("-m", "clsim", "devices")
    assert told.returncode == 0 and "works, built for " in told.stdout, told.stdout + told.stderr


def test_kernels_there_agree_with_the_reference() -> None:
    tested = run("-m", "pytest", "-n", "0", "-p", "no:cacheprovider", *ORACLES)
    assert tested.returncode == 0 and " passed" in tested.stdout, tested.stdout + tested.stderr


@pytest.mark.slow
def test_where_nothing_fits_one_sentence_says_so() -> None:
    ended = run("-c", WITHOUT_NAMES)
    assert ended.returncode == 2 and ended.stdout == ""
    told = [line for line in ended.stderr.splitlines() if ": starting (" not in line]
    assert len(told) == 1 and "unknown target CPU 'generic'" in ended.stderr, ended.stderr
