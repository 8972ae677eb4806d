"""Forked children: the threads of OpenCL, of the renderer and of a live run stay behind in the parent.

What waits for them in a child would wait for ever, and OpenCL cannot be opened a second time there.
"""

from __future__ import annotations

import gc
import os

from clsim.errors import Error

_opened = False
_orphaned = False


def open_here() -> None:
    """Note that devices are opened in this process.

    Raises:
        clsim.Error: it was forked from one in which they were.
    """
    global _opened
    check_process()
    _opened = True


def check_process() -> None:
    """Raise clsim.Error in a process that was forked from one in which devices were opened."""
    if _orphaned:
        raise Error(
            "clsim has run in the process that this one was forked from, and does not run in such a child; start "
            "workers by spawn, as with multiprocessing.get_context('spawn')"
        )


def is_orphan() -> bool:
    """Return whether this process was forked from one in which devices were opened."""
    return _orphaned


def _note_fork() -> None:
    global _orphaned
    _orphaned = _orphaned or _opened
    if _orphaned:
        # What Python has yet to throw away may hold memory of OpenCL, and would wait for those threads to let it go.
        gc.freeze()


if hasattr(os, "register_at_fork"):  # not on Windows, which has no fork
    os.register_at_fork(after_in_child=_note_fork)
