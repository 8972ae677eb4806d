from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import pytest
import typer.main

built_once = cache(typer.main.get_command)
"""The same commands for all tests: to build them takes longer than most that tests ask of them."""


@dataclass
class Outcome:
    status: int
    stdout: str
    stderr: str


@pytest.fixture
def clsim(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., Outcome]:
    """Run the command line in this process, as its entry point does."""

    def run(*arguments: object) -> Outcome:
        from clsim.cli import main

        monkeypatch.setattr(typer.main, "get_command", built_once)
        monkeypatch.setattr("sys.argv", ["clsim", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        printed = capsys.readouterr()
        code = ended.value.code
        return Outcome(code if isinstance(code, int) else 0, printed.out, printed.err)

    return run
