"""Python loads this in programs that tests start: they render with the kernels that tests share, if at all.

Nothing is imported here that the program does not import itself.
"""

import importlib.machinery
import importlib.util
import sys
from collections.abc import Callable, Sequence
from importlib.abc import MetaPathFinder
from pathlib import Path
from types import ModuleType
from typing import Any


def _compile_fast(config: Any) -> None:
    from tests.fast_compiling import compile_fast

    compile_fast(config)


def _declare_little(workplace: Any) -> None:
    from tests.fast_compiling import declare_little

    declare_little(workplace)


def _share(scene_features: Any) -> None:
    # A worker of pytest's has tests that choose for themselves; a process that a test starts may import pytest, too.
    if "pytest" in sys.modules and "--multiprocessing-fork" not in sys.orig_argv:
        return
    from tests.shared_kernels import ORDINARY, widened

    scene_features.scene_features = widened(scene_features.scene_features, ORDINARY)


class _Afterwards(MetaPathFinder):
    """Does something to modules once they are imported."""

    def __init__(self, todo: dict[str, Callable[[ModuleType], None]]) -> None:
        """Take what is to be done, by the modules' names."""
        self._todo = todo

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Return what others find, with what is to be done after it."""
        todo = self._todo.pop(fullname, None)
        spec = importlib.util.find_spec(fullname) if todo else None
        if spec is None or spec.loader is None or todo is None:
            return None
        run = spec.loader.exec_module

        def exec_module(module: ModuleType) -> None:
            run(module)
            sys.path.append(str(Path(__file__).parents[2]))
            todo(module)

        spec.loader.exec_module = exec_module  # type: ignore[method-assign]
        return spec


_AFTER_IMPORT = {
    "warp.config": _compile_fast,
    "clsim.opencl.workplace": _declare_little,
    "clsim.render.features.scene_features": _share,
}
sys.meta_path.insert(0, _Afterwards(_AFTER_IMPORT))
