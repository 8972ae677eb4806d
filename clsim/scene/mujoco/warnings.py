"""What MuJoCo warns of: it writes that into a file of its own in the working folder, unless someone takes it."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator


@contextlib.contextmanager
def warnings_to(found: list[str]) -> Iterator[None]:
    """Add the warnings to a list meanwhile, as single lines."""
    import mujoco

    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda text: found.append(" ".join(str(text).split())))
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)
