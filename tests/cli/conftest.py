from collections.abc import Callable
from dataclasses import dataclass

import pytest


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

        monkeypatch.setattr("sys.argv", ["clsim", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        printed = capsys.readouterr()
        code = ended.value.code
        return Outcome(code if isinstance(code, int) else 0, printed.out, printed.err)

    return run
