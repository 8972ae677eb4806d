"""The clsim command."""

from __future__ import annotations

import atexit
import errno
import gc
import os
import signal
import sys
import warnings
from collections.abc import Callable
from typing import Any

_OBJECTS = 1_000_000
"""Objects that are made before Python looks for some that are of no use any more; it does so after 700 by itself."""


def main() -> None:
    """Run the command line; wrong input ends it with one sentence and status 2."""
    # Modules and kernels stay for good. Looking through them while they are made takes a tenth of a start.
    gc.set_threshold(_OBJECTS)
    # At the end all is given back with the process. To look through it once more takes a quarter of a short run.
    atexit.register(gc.freeze)
    # Matrices are small here. NumPy's threads for large ones would wait for them, and not idly.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Who asks a run to end, as schedulers and containers do, wants its files whole and its summary, as of Ctrl-C.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    # So does who closes the terminal; but nohup says that it shall not matter. Windows has no such signal.
    hangup = getattr(signal, "SIGHUP", None)
    if hangup is not None and signal.getsignal(hangup) != signal.SIG_IGN:
        signal.signal(hangup, signal.default_int_handler)
    from clsim.cli.streams import keep_streams

    keep_streams()
    import typer

    from clsim.cli.app import app
    from clsim.cli.spelling import as_options
    from clsim.errors import Error

    warnings.showwarning = _with_notices(warnings.showwarning)
    # Typer has its own copy of click in recent versions; either way this is the base of its usage errors.
    usage_error: Any = next(kind for kind in typer.BadParameter.__mro__ if kind.__name__ == "ClickException")
    try:
        status = app(prog_name="clsim", standalone_mode=False)
        sys.exit(status if isinstance(status, int) else 0)
    except Error as error:
        print(f"clsim: {as_options(str(error))}", file=sys.stderr)
        sys.exit(2)
    except (typer.Abort, KeyboardInterrupt):
        sys.exit(130)
    except BrokenPipeError:
        # Whoever read our standard output has gone; Python must not try to flush it at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except OSError as error:
        # Only this one comes of what the user wrote, wherever a path is looked at first.
        if error.errno != errno.ENAMETOOLONG:
            raise
        print(f"clsim: {error.filename}: {error.strerror}", file=sys.stderr)
        sys.exit(2)
    except Exception as error:
        if not isinstance(error, usage_error):
            raise
        from clsim.cli.usage import usage_sentence

        sentence = usage_sentence(error)
        if sentence:
            print(f"clsim: {sentence}", file=sys.stderr)
        sys.exit(2)


def _with_notices(show_others: Callable[..., None]) -> Callable[..., None]:
    """Return what shows warnings: those of ours once, in one sentence, without a place in the code."""
    from clsim.cli.spelling import as_options
    from clsim.errors import Notice

    shown: set[str] = set()

    def show(message: Warning | str, category: type[Warning], *where: Any) -> None:
        if issubclass(category, Notice):
            if str(message) not in shown:
                shown.add(str(message))
                print(f"clsim: {as_options(str(message))}", file=sys.stderr)
        else:
            show_others(message, category, *where)

    return show
