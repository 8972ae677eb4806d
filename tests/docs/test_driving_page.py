"""The examples of the pages on driving a simulator run."""

import re
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
EXAMPLES = {
    (page, heading): code
    for page in ("driving.md", "robots.md", "renderers.md", "scenes.md")
    for section in re.split(r"^##+ ", (DOCS / page).read_text(), flags=re.MULTILINE)[1:]
    for heading, code in [(section.partition("\n")[0], "".join(re.findall(r"```python\n(.*?)```", section, re.DOTALL)))]
    if code
}
_QUICK = "Any renderer"


def test_there_are_examples() -> None:
    assert {page for page, _ in EXAMPLES} == {"driving.md", "robots.md", "renderers.md", "scenes.md"}
    assert len(EXAMPLES) >= 8


@pytest.mark.parametrize(
    ("page", "heading"),
    [name if name[1] == _QUICK else pytest.param(*name, marks=pytest.mark.slow) for name in EXAMPLES],
)
def test_an_example_runs_and_fires(page: str, heading: str, capsys: pytest.CaptureFixture[str]) -> None:
    code = EXAMPLES[page, heading]
    for library in re.findall(r"^import (mujoco|gymnasium)", code, re.MULTILINE):
        pytest.importorskip(library, reason=f"{library} is not installed")
    names: dict[str, object] = {}
    exec(compile(code, page, "exec"), names)
    printed = capsys.readouterr().out
    counts = [int(count) for count in re.findall(r"(\d+) events", printed)]
    assert "offsets" in names or max(counts) > 20
