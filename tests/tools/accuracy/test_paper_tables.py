"""The table maker on frames small enough to look at."""

import json

import numpy as np
import pytest

from clsim.frames.exr import ExrWriter
from tests.cli.conftest import clsim  # noqa: F401
from tests.detect.reference_scenes import random_frames
from tools.accuracy import paper_tables

SIZE = {"count": 4, "height": 9, "width": 11}


@pytest.fixture
def folder(tmp_path):
    for name, noise in (("noisy", 0.2), ("clean", 0.0), ("clean2", 0.02)):
        writer = ExrWriter(tmp_path / name)
        for frame in random_frames(3, noise=noise, **SIZE):
            writer.write(frame)
    return tmp_path


def make(monkeypatch, *arguments):
    monkeypatch.setattr("sys.argv", ["paper_tables.py", *map(str, arguments)])
    paper_tables.main()


def cells(text, start):
    line = next(line for line in text.splitlines() if line.startswith(start))
    return [cell.strip() for cell in line.split("|")[1:-1]]


@pytest.mark.slow
def test_the_table_says_what_detect_and_score_say(folder, monkeypatch, clsim):  # noqa: F811
    monkeypatch.chdir(folder)
    out = folder / "table.md"
    options = ["--sequences", "noisy", "--reference", "clean", "--ceiling", "clean2", "--fps", 100]
    make(monkeypatch, "recorded", folder, *options, "--threshold", "0.1,0.3", "--rule", "interpolated",
         "--methods", "esim,radiance K9 T3", "--out", out, "--plots", folder / "curve")  # fmt: skip
    text = out.read_text()
    second = text[text.index("### C = 0.3") :]
    common = ["--fps", 100, "--threshold", 0.3]
    clsim("detect", folder / "clean", "--out", "ref.npz", "--method", "esim", *common)
    detected = clsim("detect", folder / "noisy", "--out", "got.npz", "--window", 9, "--history", 3, *common, "--json")
    solved = json.loads(detected.stdout)["solved_share"]
    size = ["--resolution", "11x9", "--fps", 100, "--json"]
    scores = json.loads(clsim("score", "got.npz", "ref.npz", *size).stdout)
    found = cells(second, "| radiance K9 T3 | noisy")
    number = paper_tables.number
    assert found[2:5] == [number(scores[name]) for name in ("precision", "recall", "f1")]
    assert found[6:8] == [number(scores[name]) for name in ("strict_precision", "strict_recall")]
    assert found[8] == f"{scores['dt_median_us'] / 1000:.2f}" and found[11] == number(solved)
    assert found[10] == f"{scores['events']} / {scores['reference_events']}"
    assert cells(second, "| radiance K9 T3 | .")[1].startswith(f"{number(scores['f1'])} (")
    assert cells(second, "| ceiling (esim) | –")[11] == "–"
    plots = sorted(path.name for path in folder.glob("curve*.png"))
    assert plots == ["curve-noisy-interpolated-0.1.png", "curve-noisy-interpolated-0.3.png"]
    assert (folder / plots[0]).read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_a_rendered_scene_against_its_own_reference(monkeypatch, capsys):
    make(monkeypatch, "rendered", "two-boxes", "--resolution", "12x8", "--frames", 3, "--spp", 2, "--reference-spp", 4,
         "--noise", "common", "--methods", "esim")  # fmt: skip
    printed = capsys.readouterr().out
    assert cells(printed, "| esim | common 2 spp")[1] == "common 2 spp"
    assert not np.isnan(float(cells(printed, "| ceiling (esim) | –")[4]))
