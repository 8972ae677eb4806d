"""The scripts and notebooks in `examples` run, and draw what docs/examples.md shows."""

import json
import re
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

ROOT = Path(__file__).parents[2]
SCRIPTS = sorted(path.stem for path in (ROOT / "examples").glob("*.py") if path.stem != "pictures")
NOTEBOOKS = sorted(path.stem for path in (ROOT / "examples").glob("*.ipynb"))
_QUICK = "any_renderer"
_NEEDS = {"mujoco_pendulum": "mujoco", "environment_loop": "gymnasium", "voxel_grids": "distributed"}


def test_each_example_has_its_picture_on_the_page() -> None:
    page = (ROOT / "docs" / "examples.md").read_text()
    assert re.findall(r"<!-- made: source examples/(\w+)\.py -->", page) == re.findall(r"\(images/examples/(\w+)", page)
    assert sorted(re.findall(r"\(images/examples/(\w+)\.png\)", page)) == SCRIPTS
    assert (
        sorted(re.findall(r"\(\.\./examples/(\w+)\.ipynb\)", page)) == sorted(["first_steps", "quality"]) == NOTEBOOKS
    )
    assert sum(path.stat().st_size for path in (ROOT / "docs" / "images" / "examples").iterdir()) < 1_500_000


def test_examples_are_short() -> None:
    for name in SCRIPTS:
        assert len((ROOT / "examples" / f"{name}.py").read_text().splitlines()) <= 62, name


@pytest.mark.parametrize(
    "name", [name if name == _QUICK else pytest.param(name, marks=pytest.mark.slow) for name in SCRIPTS]
)
def test_a_script_runs_and_draws(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if name in _NEEDS:
        pytest.importorskip(_NEEDS[name], reason=f"{_NEEDS[name]} is not installed")
    target = tmp_path / "drawn.png"
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [name, str(target)])
    monkeypatch.syspath_prepend(ROOT / "examples")
    runpy.run_path(str(ROOT / "examples" / f"{name}.py"), run_name="__main__")
    drawn, shown = Image.open(target), Image.open(ROOT / "docs" / "images" / "examples" / f"{name}.png")
    assert drawn.size == shown.size
    # Noise of a machine may move a few events; a panel that is empty, or another, is a fault.
    off = np.abs(np.asarray(drawn.convert("L"), float) - np.asarray(shown.convert("L"), float)).mean()
    assert np.asarray(drawn.convert("L")).std() > 20 and off < 12


@pytest.mark.slow
@pytest.mark.parametrize("name", NOTEBOOKS)
def test_a_notebook_runs(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    notebook = json.loads((ROOT / "examples" / f"{name}.ipynb").read_text())
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for cell in notebook["cells"]:
        assert not cell.get("outputs")
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), f"{name}.ipynb", "exec"), names)
    assert np.asarray(names["picture"]).std() > 20
