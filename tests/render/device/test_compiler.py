"""Precompiled headers are kept where the next process finds them, and nothing is compiled twice."""

import ast
import os
import re
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
import warp as wp

from clsim import render
from clsim.render.device.compiler import one_at_a_time

FOX = Path(__file__).parents[3].parent / "shared" / "assets" / "gltf" / "Fox.glb"
BUILD = """
import threading
import warp as wp
from clsim.render.device.devices import start_warp

start_warp()
number = {number}

@wp.kernel(enable_backward=False)
def count(out: wp.array(dtype=int)):
    out[wp.tid()] = number

thread = threading.Thread(target=wp.load_module, args=("__main__", "cpu"))
thread.start()
thread.join()
"""


@pytest.mark.slow
def test_threads_and_processes_share_them(tmp_path: Path) -> None:
    cache = os.environ | {"WARP_CACHE_PATH": str(tmp_path / "kernels"), "TMPDIR": str(tmp_path)}

    def build(number: int) -> dict[Path, int]:
        """Build a kernel in a process of its own; return the headers that there are, and when they were written."""
        script = tmp_path / f"build{number}.py"
        script.write_text(BUILD.format(number=number))
        subprocess.run([sys.executable, script], env=cache, check=True)
        return {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.pch")}

    first = build(1)
    assert len(first) == 1, "Warp keeps precompiled headers elsewhere: see clsim/render/device/compiler.py"
    assert build(2) == first
    assert len(list(tmp_path.rglob("*.o"))) == 2  # both were built


AHEAD = """
from pathlib import Path
from warp._src import context
from clsim.render.device.compiler import precompile_headers
from clsim.render.device.devices import start_warp

start_warp()
precompile_headers("cpu")
print(*Path(context.runtime.get_clang_pch_dir()).glob("*.pch"))
"""


@pytest.mark.slow
def test_what_compiles_while_they_are_precompiled_waits_for_them(tmp_path: Path) -> None:
    about = os.environ | {"WARP_CACHE_PATH": str(tmp_path)}
    told = subprocess.run([sys.executable, "-c", AHEAD], env=about, check=True, capture_output=True, text=True).stdout
    assert len(told.split()) == 1


def test_no_two_threads_declare_kernels_at_a_time():
    """What Warp notes of a kernel while it is declared would be of both."""
    inside, most, made = [], [], []

    def declare(number):
        inside.append(number)
        time.sleep(0.01)
        most.append(len(inside))
        inside.pop()
        made.append(number)
        return number

    builders = [one_at_a_time(lambda number: declare(number)) for _ in range(2)]
    threads = [threading.Thread(target=builder, args=(k % 2,)) for k in range(4) for builder in builders]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert most == [1] * 4 and sorted(made) == [0, 0, 1, 1]


DECLARE = """
import warp as wp
import clsim.render
from clsim.render.device import compiler

inside, declare = [], wp.kernel

def noted(*args, **kwargs):
    inside.append(compiler._DECLARING._is_owned())
    return declare(*args, **kwargs)

wp.kernel = noted
from clsim.render.cache.light_updates import build_updates
from clsim.render.subframe.motion_field import build_pass_over
assert not inside, "importing declares kernels"
build_updates(), build_pass_over()
assert inside and all(inside), inside
"""


def test_kernels_of_all_scenes_are_declared_one_at_a_time_too():
    """A module of kernels may be imported by one thread while another declares."""
    subprocess.run([sys.executable, "-c", DECLARE], check=True)


def test_no_name_in_a_kernel_is_a_constant_of_warp() -> None:
    """Warp takes `e.rays` for its number e until the function is compiled, and then compiles its kernels anew."""
    constants = {name for name, value in vars(wp).items() if isinstance(value, float)}
    assert "e" in constants
    for file in Path(render.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                assert node.value.id not in constants, f"{file.name}:{node.lineno}: {ast.unparse(node)}"


@pytest.mark.slow
@pytest.mark.skipif(not FOX.exists(), reason="shared scenes are not there")
@pytest.mark.parametrize("time", ["fixed", "adaptive"])
def test_kernels_are_whole(time: str, tmp_path: Path) -> None:
    """No function in them is called with a scene: each call would copy three kilobytes, and pixels make many."""
    options = ["--resolution", "16x12", "--frame-count", "2", "--time", time]
    command = [sys.executable, "-m", "clsim", "live", str(FOX), *options]
    # As for users: programs of tests compile in half the time, and inline less.
    about = os.environ | {"WARP_CACHE_PATH": str(tmp_path), "PYTHONPATH": str(Path(__file__).parents[3])}
    subprocess.run(command, check=True, env=about, capture_output=True)
    kernels = [each.read_bytes() for name in ("render", "retrace") for each in tmp_path.rglob(f"*__{name}_*.o")]
    assert len(kernels) == (1 if time == "fixed" else 2)
    assert len(list(tmp_path.rglob("*.pch"))) == 1, "headers take seconds: kernels of a run have the same options"
    for kernel in kernels:
        assert re.search(rb"_Z\w*Scene_", kernel), "its symbols tell the types of arguments"
        assert re.findall(rb"_ZL\w*Scene_\w*", kernel) == []


def test_what_python_parsed_by_mistake_is_parsed_again() -> None:
    """Of two threads that parse at a time, one may be told that its tree is as deep as the other's."""
    told = [SystemError("AST constructor recursion depth mismatch (before=72, after=83)")] * 2
    asked = []

    @one_at_a_time
    def declare(number: int) -> int:
        asked.append(number)
        if told:
            raise told.pop()
        return number

    assert declare(7) == 7 and asked == [7, 7, 7]
    told += [SystemError("AST constructor recursion depth mismatch (before=72, after=83)")] * 9
    with pytest.raises(SystemError, match="mismatch"):
        declare(8)
    told[:] = [SystemError("something else")]
    asked.clear()
    with pytest.raises(SystemError, match="else"):
        declare(9)
    assert asked == [9]
