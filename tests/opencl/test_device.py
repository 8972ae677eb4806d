"""Which device is chosen, and what is said of those that do not work."""

import json
import warnings
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pyopencl as cl
import pytest

from clsim.caches import cache_folder
from clsim.errors import InputError, Notice
from clsim.opencl import device as devices
from clsim.opencl import trial
from clsim.opencl.device import choose_device, find_devices


class Broken:
    """A device that is listed, and builds nothing."""

    def __init__(self, name: str, kind: Any, vendor: str = "Acme") -> None:
        self.name, self.version, self.driver_version, self.type = name, "OpenCL 3.0", "1.2", kind
        self.platform = SimpleNamespace(name=vendor, version="OpenCL 3.0", get_devices=lambda: [self])


GPU = Broken("Turbo", cl.device_type.GPU)
CPU = Broken("Slow", cl.device_type.CPU)
FAULT = "it builds no kernel (error: unknown target CPU 'generic')"


@pytest.fixture
def broken(monkeypatch: pytest.MonkeyPatch) -> Any:
    """List these besides what is there, or instead."""
    real = cl.get_platforms()
    tried = trial.fault_of

    def listed(*fakes: Broken, alone: bool = False) -> None:
        monkeypatch.setattr(cl, "get_platforms", lambda: [each.platform for each in fakes] + ([] if alone else real))
        monkeypatch.setattr(devices, "fault_of", lambda each: FAULT if isinstance(each, Broken) else tried(each))
        devices._say_passed_over.cache_clear()

    return listed


def test_what_does_not_build_is_passed_over_with_a_word(broken: Any) -> None:
    broken(GPU, CPU)
    with pytest.warns(Notice, match=f"passed over an OpenCL device, Turbo .*{FAULT[:20]}.*driver of its maker") as said:
        chosen = choose_device()
    assert len(said) == 1 and "Turbo" not in chosen.name
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        choose_device()  # said once
    first = find_devices()[0]
    assert first.name.startswith("Turbo ") and first.fault == FAULT


def test_of_all_that_a_driver_says_the_error_is_told() -> None:
    said = "clBuildProgram failed: BUILD_PROGRAM_FAILURE\n\nBuild on Slow:\nfatal error: no file 'a.h'\n1 more"
    assert trial.reason_in(RuntimeError(said)) == "fatal error: no file 'a.h'"
    assert trial.reason_in(RuntimeError(" out of host memory\nat build")) == "out of host memory"


@pytest.mark.parametrize("spelled", [str.lower, str.upper])
def test_who_names_a_device_that_works_hears_of_no_other(broken: Any, spelled: Callable[[str], str]) -> None:
    broken(Broken(f"{trial.POCL} on a Turbo", cl.device_type.GPU))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        chosen = choose_device(spelled(trial.POCL))
    assert "Turbo" not in chosen.name and trial.POCL in chosen.name


def test_where_none_works_a_sentence_says_why_and_what_to_do(broken: Any) -> None:
    broken(CPU, alone=True)
    with pytest.raises(InputError, match=r"no OpenCL device works: Slow .*'generic'\); install another PoCL"):
        choose_device()
    with pytest.raises(InputError, match=r"no OpenCL device named 'slow' works: .*'generic'"):
        choose_device("slow")
    with pytest.raises(InputError, match=r"no OpenCL device is named 'quick'"):
        choose_device("quick")


@pytest.mark.parametrize(
    ("kind", "native", "lanes"), [("GPU", 1, 1), ("GPU", 4, 1), ("CPU", 4, 4), ("CPU", 16, 16), ("CPU", 1, 8)]
)
def test_kernels_are_as_wide_as_a_cpus_registers_and_one_pixel_on_a_gpu(
    monkeypatch: pytest.MonkeyPatch, kind: str, native: int, lanes: int
) -> None:
    device: Any = Broken("Turbo", getattr(cl.device_type, kind))
    device.native_vector_width_float = native
    monkeypatch.setattr(cl, "Context", lambda found: found)
    opened = devices._open(device)
    assert (opened.lanes, opened.is_cpu) == (lanes, kind == "CPU")


@pytest.mark.parametrize("platforms", [lambda: [], lambda: (_ for _ in ()).throw(cl.LogicError("no platform"))])
def test_where_there_is_none_a_sentence_says_what_to_do(monkeypatch: pytest.MonkeyPatch, platforms: Any) -> None:
    monkeypatch.setattr(cl, "get_platforms", platforms)
    with pytest.raises(InputError, match="no OpenCL device was found; install PoCL, as by apt-get install"):
        choose_device()
    assert find_devices() == []


def test_the_command_says_what_works_and_what_does_not(broken: Any, capsys: pytest.CaptureFixture[str]) -> None:
    from clsim.cli.commands.devices import devices as command

    broken(GPU)
    command()
    said = capsys.readouterr().out
    assert f"Turbo (Acme, OpenCL 3.0)\n    does not work: {FAULT}; install the driver of its maker\n" in said
    assert "    works" in said
    command(as_json=True)
    told = json.loads(capsys.readouterr().out)
    assert told["opencl"] and not any("Turbo" in name for name in told["opencl"])
    (only,) = told["opencl_broken"]
    assert "Turbo" in only["name"] and (only["why"], only["do"]) == (FAULT, "install the driver of its maker")


def test_a_trial_is_remembered_for_a_device_a_driver_and_a_processor(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    real = cl.get_platforms()[0].get_devices()[0]
    tried = []
    outcome: list[str | None] = [None]
    monkeypatch.setattr(trial, "_try_outside", lambda device, told: tried.append(device) or outcome[0])

    def fault() -> str | None:
        trial.fault_of.cache_clear()
        return trial.fault_of(real)

    assert fault() is None and fault() is None and len(tried) == 1
    monkeypatch.setattr(trial, "_processor", lambda: {"model name": "another"})
    assert fault() is None and len(tried) == 2
    outcome[0] = FAULT
    monkeypatch.setattr(trial, "_processor", lambda: {"model name": "a third"})
    assert fault() == FAULT and fault() == FAULT and len(tried) == 4  # it may be mended meanwhile
    assert len(list((cache_folder() / "opencl").iterdir())) == 2
    trial.fault_of.cache_clear()


def test_whatever_of_a_device_its_driver_or_clsim_is_another_it_is_tried_anew(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A driver that was updated may crash where the older one did not."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    tried: list[Any] = []
    monkeypatch.setattr(trial, "_try_outside", lambda device, told: tried.append(device))

    def is_tried(change: Callable[[Broken], None] = lambda device: None) -> bool:
        device, before = Broken("Turbo", cl.device_type.GPU), len(tried)
        change(device)
        assert trial.fault_of(device) is None
        return len(tried) > before

    assert is_tried() and not is_tried()
    for name in ("name", "version", "driver_version"):
        assert is_tried(lambda device, name=name: setattr(device, name, "2.0")), name
    for name in ("name", "version"):
        assert is_tried(lambda device, name=name: setattr(device.platform, name, "2.0")), name
    monkeypatch.setattr(trial, "told_name", lambda device: "haswell")
    assert is_tried()
    monkeypatch.setattr(trial, "VERSION", "0.0.0")
    assert is_tried() and not is_tried()


def test_a_trial_sees_what_is_computed_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    real = cl.get_platforms()[0].get_devices()[0]
    assert trial._try(real) is None
    monkeypatch.setattr(trial, "_KERNEL", trial._KERNEL.replace("exp(", "exp2("))
    assert trial._try(real) == "it computes something wrong"
    monkeypatch.setattr(trial, "_KERNEL", "kernel void trial(")
    assert str(trial._try(real)).startswith("it builds no kernel (")


CRASHING = """
import os, signal, sys
if sys.argv[0] == "-m" and "clsim.opencl.trial" in sys.orig_argv:
    os.kill(os.getpid(), signal.SIGSEGV)
"""


def test_a_driver_that_crashes_is_passed_over(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    real = cl.get_platforms()[0].get_devices()[0]
    assert trial._try_outside(real, trial.told_name(real)) is None
    (tmp_path / "sitecustomize.py").write_text(CRASHING)
    monkeypatch.syspath_prepend(tmp_path)
    assert trial._try_outside(real, None) == "it crashes where it builds a small kernel (SIGSEGV)"


def test_what_is_computed_wrong_outside_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    real = cl.get_platforms()[0].get_devices()[0]
    (tmp_path / "sitecustomize.py").write_text("import numpy; numpy.allclose = lambda *_, **__: False")
    monkeypatch.syspath_prepend(tmp_path)
    assert trial._try_outside(real, trial.told_name(real)) == "it computes something wrong"
