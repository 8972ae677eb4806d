"""Models of MuJoCo's on the command line."""

import json
from pathlib import Path

import pytest

pytest.importorskip("mujoco", reason="mujoco is not installed")
ROBOT = """<mujoco><worldbody><light pos="0 0 3"/><geom type="plane" size="2 2 .1"/>
    <body pos="0 0 1"><joint axis="0 1 0"/><geom size=".1 .3" pos=".3 0 0" type="capsule"/></body>
    </worldbody></mujoco>"""


@pytest.mark.slow
def test_a_model_runs_live_and_is_told_of(clsim, tmp_path: Path) -> None:
    path, out = tmp_path / "robot.xml", tmp_path / "events.npz"
    path.write_text(ROBOT)
    told = clsim("info", path, "--json")
    assert told.status == 0, told.stderr
    assert json.loads(told.stdout)["scene"]["duration_s"] == 5.0
    small = ("--resolution", "48x36", "--quality", "draft", "--duration", "0.1", "--view", "none")
    ran = clsim("live", path, "--out", out, *small, "--json")
    assert ran.status == 0, ran.stderr
    assert json.loads(ran.stdout.splitlines()[-1])["events"] > 100
