"""The clsim command."""

from __future__ import annotations

import os
import sys


def main() -> None:
    """Run the command line; wrong input ends it with one sentence and status 2."""
    import click

    from clsim.cli.app import app
    from clsim.errors import InputError

    try:
        status = app(prog_name="clsim", standalone_mode=False)
        sys.exit(status if isinstance(status, int) else 0)
    except InputError as error:
        print(f"clsim: {error}", file=sys.stderr)
        sys.exit(2)
    except click.ClickException as error:
        print(f"clsim: {error.format_message()}", file=sys.stderr)
        sys.exit(2)
    except (click.Abort, KeyboardInterrupt):
        sys.exit(130)
    except BrokenPipeError:
        # Whoever read our standard output has gone; Python must not try to flush it at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
