"""How the suite runs: in parallel where pytest-xdist is installed, with working interrupts, and by no clock."""

import os
import signal
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

# How long an example takes tells of the machine and of what else it does.
settings.register_profile("clsim", deadline=None)
settings.load_profile("clsim")

_RENDER_BY_THE_WAY = ("bench", "bridges", "cli", "datasets", "docs", "live", "scene", "simulator", "tools", "truth")
"""Folders whose tests render small worlds, but are not about how; those in `tests/render` choose for themselves."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add what the suite can be asked for."""
    parser.addoption(
        "--own-kernels", action="store_true", help="render every world with the kernel that users get, built for it"
    )


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config: pytest.Config) -> None:
    """Run the whole suite (no paths given, no -n, no debugger) on up to four cores: most of it is compiling kernels.

    So is most of what ``--own-kernels`` asks for, whatever the paths.

    In ``addopts``, ``-n`` would be an error where the plugin is missing.
    """
    whole = config.args_source is pytest.Config.ArgsSource.TESTPATHS or config.option.own_kernels
    if not (whole and config.pluginmanager.hasplugin("xdist")) or config.option.numprocesses is not None:
        return
    # Workers come here too, and must not have workers of their own.
    if not (hasattr(config, "workerinput") or config.option.usepdb or config.option.collectonly):
        config.option.numprocesses = min(4, os.cpu_count() or 1)
        # Neighbours in a file share kernels, so that each worker gets tests in a row.
        config.option.dist = "worksteal"


def pytest_configure(config: pytest.Config) -> None:
    """Let interrupts work, and compile kernels in half the time: they render little here.

    With ``--own-kernels`` all are compiled as for users.
    """
    # A shell's background jobs ignore interrupts, and so would programs that tests start.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if not (config.option.own_kernels or config.option.collectonly):
        import warp as wp

        from clsim.opencl import workplace
        from tests.fast_compiling import compile_fast, declare_little

        os.environ.setdefault("PYOPENCL_BUILD_OPTIONS", "-cl-opt-disable")
        compile_fast(wp.config)
        declare_little(workplace)
        # So do programs that tests start, fixtures of whole files included; they share kernels, too.
        programs, path = str(Path(__file__).parent / "programs"), os.environ.get("PYTHONPATH", "")
        if programs not in path.split(os.pathsep):
            os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (programs, path)))


@pytest.fixture(autouse=True)
def ordinary_kernels(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    """Let tests that are not about rendering share kernels (``tests/shared_kernels.py``)."""
    if request.path.relative_to(Path(__file__).parent).parts[0] in _RENDER_BY_THE_WAY:
        from tests.shared_kernels import ORDINARY, widen

        widen(monkeypatch, request, ORDINARY)


@pytest.fixture(scope="module")
def mi() -> Any:
    """Mitsuba 3 for pictures: with LLVM if that works here, else slowly.

    Set anew for each module, as some tests set a variant of their own.
    """
    from tools.peers.mitsuba_variant import LLVM, SCALAR

    return _mitsuba_or_skip(LLVM, SCALAR)


@pytest.fixture(scope="module")
def llvm_mitsuba() -> Any:
    """Mitsuba 3 for tools that time it: with LLVM or not at all."""
    from tools.peers.mitsuba_variant import LLVM

    return _mitsuba_or_skip(LLVM)


def _mitsuba_or_skip(*variants: str) -> Any:
    from clsim.errors import InputError
    from tools.peers.mitsuba_variant import load_mitsuba

    try:
        return load_mitsuba(*variants)
    except InputError as error:
        pytest.skip(str(error))
