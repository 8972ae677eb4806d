"""Folders for what is computed once and kept: those of the user, or others where these cannot be written.

The compilers of kernels all keep what they compiled, and none of them works where it cannot.
"""

from __future__ import annotations

import contextlib
import os
import stat
import tempfile
import threading
import warnings
from functools import cache
from pathlib import Path

from clsim.errors import InputError, Notice

_VARIABLE = "XDG_CACHE_HOME"
_COMPILERS = {"warp": "WARP_CACHE_PATH", "pocl": "POCL_CACHE_DIR", "pyopencl": "PYOPENCL_CACHE_DIR", "pytools": None}
"""Folders in the user's cache, and the variables that lead elsewhere; pyopencl keeps things in that of pytools too."""
_OURS = "clsim"
_lock = threading.Lock()


def prepare_caches() -> None:
    """See that all compilers can keep what they compile: elsewhere, with a warning, where that cannot be written.

    Raises:
        InputError: nothing can be written, not even a temporary folder.
    """
    with _lock:
        _prepare(tuple(os.environ.get(name) for name in (_VARIABLE, "HOME", *filter(None, _COMPILERS.values()))))


def cache_folder() -> Path:
    """Return the folder for what clsim keeps itself, in the user's cache or, if need be, elsewhere; it exists.

    Raises:
        InputError: nothing can be written, not even a temporary folder.
    """
    prepare_caches()
    folder = users_cache()
    assert folder is not None, "prepared"
    (folder / _OURS).mkdir(parents=True, exist_ok=True)
    return folder / _OURS


def users_cache() -> Path | None:
    """Return the user's cache, as the system's conventions have it; None if this user has no home."""
    told = os.environ.get(_VARIABLE)
    if told and os.path.isabs(told):
        return Path(told)
    home = os.path.expanduser("~")
    return Path(home) / ".cache" if os.path.isabs(home) else None


@cache
def _prepare(told: tuple[str | None, ...]) -> None:
    """Do it once for what the environment says."""
    folder = users_cache()
    by_default = [_OURS, *(name for name, own in _COMPILERS.items() if own is None or not os.environ.get(own))]
    moved = []
    if folder is None or not all(_can_write(folder / name) for name in by_default):
        moved.append((_VARIABLE, str(folder or "the cache of a user without a home")))
        os.environ[_VARIABLE] = str(_spare_folder(moved[0][1]))
    for name, own in _COMPILERS.items():
        place = os.environ.get(own) if own else None
        if own and place and not _can_write(Path(place)):
            moved.append((own, place))
            os.environ[own] = str(_spare_folder(place) / name)
    for variable, place in moved:
        warnings.warn(
            f"{place} cannot be written, so what is compiled is kept in {os.environ[variable]}; set {variable} to a "
            "folder of your own",
            Notice,
            stacklevel=2,
        )


def _can_write(folder: Path) -> bool:
    """Return whether files can be made in a folder, which is made if it is not there."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _spare_folder(instead_of: str) -> Path:
    """Return a temporary folder that is there again in the next run, and in which nobody else can put kernels."""
    try:
        fixed = Path(tempfile.gettempdir()) / f"clsim-cache-{os.getuid() if hasattr(os, 'getuid') else 'user'}"
        with contextlib.suppress(OSError):
            fixed.mkdir(mode=0o700, exist_ok=True)
            if _is_mine_alone(fixed) and _can_write(fixed):
                return fixed
        return Path(tempfile.mkdtemp(prefix="clsim-cache-"))
    except OSError:
        raise InputError(
            f"kernels cannot be kept: neither {instead_of} nor a temporary folder can be written; set {_VARIABLE} to "
            "a folder that can"
        ) from None


def _is_mine_alone(folder: Path) -> bool:
    about = folder.lstat()
    mine = not hasattr(os, "getuid") or about.st_uid == os.getuid()
    return stat.S_ISDIR(about.st_mode) and mine and not about.st_mode & 0o022
