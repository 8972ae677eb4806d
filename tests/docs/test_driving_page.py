"""The examples of docs/driving.md run."""

import re
from pathlib import Path

import pytest

PAGE = (Path(__file__).parents[2] / "docs" / "driving.md").read_text()
EXAMPLES = {
    heading: code
    for section in re.split(r"^## ", PAGE, flags=re.MULTILINE)[1:]
    for heading, code in [(section.partition("\n")[0], "".join(re.findall(r"```python\n(.*?)```", section, re.DOTALL)))]
    if code
}


@pytest.mark.parametrize(
    "heading", [name if name == "Any renderer" else pytest.param(name, marks=pytest.mark.slow) for name in EXAMPLES]
)
def test_an_example_runs_and_fires(heading: str, capsys: pytest.CaptureFixture[str]) -> None:
    for library in re.findall(r"^import (mujoco|gymnasium)", EXAMPLES[heading], re.MULTILINE):
        pytest.importorskip(library, reason=f"{library} is not installed")
    names: dict[str, object] = {}
    exec(compile(EXAMPLES[heading], "driving.md", "exec"), names)
    counts = [int(count) for count in re.findall(r"(\d+) events", capsys.readouterr().out)]
    assert "offsets" in names or max(counts) > 20
