"""The scene of a run that is repeated from its sidecar, where files have moved since."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from clsim.cli.options.config import read_config


def sidecar(folder: Path, scene: str, beside: str) -> Path:
    """Write a sidecar that tells where its scene was, and where that lies from here."""
    path = folder / "events.h5.json"
    path.write_text(json.dumps({"options": {"scene": scene}, "scene_from_here": beside}))
    return path


@pytest.mark.parametrize("part", ["", "#walk", "#2"])
def test_a_scene_that_moved_with_its_sidecar_is_found_whole_or_in_part(tmp_path: Path, part: str) -> None:
    """``#walk`` names an animation of the file, and is no part of the file's name."""
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "a.glb").touch()
    there, gone = str(tmp_path / "models" / "a.glb"), "/no/such/folder/a.glb"
    found = read_config(sidecar(tmp_path, gone + part, "models/a.glb" + part))["scene"]
    assert found == there + part
    # Where it was, it still is; and of two that are gone, the first is told.
    assert read_config(sidecar(tmp_path, there + part, "other.glb" + part))["scene"] == there + part
    assert read_config(sidecar(tmp_path, gone + part, "other.glb" + part))["scene"] == gone + part


def test_a_file_that_lies_beside_the_one_that_tells_it_is_found_from_any_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What lies where the command runs comes first, as ever; names of bundled scenes and of sensors are no files."""
    names = {"scene": "a.glb#walk", "camera_path": "poses.txt", "sensor": "davis346", "imu_noise": "gone.yaml"}
    there, here = tmp_path / "there", tmp_path / "here"
    for folder in (there, here):
        folder.mkdir()
    for name in ("a.glb", "poses.txt", "davis346"):
        (there / name).touch()
    (there / "run.toml").write_text("".join(f'{key} = "{name}"\n' for key, name in names.items()))
    monkeypatch.chdir(here)
    found = read_config(Path("../there/run.toml"))
    assert found == names | {"scene": "../there/a.glb#walk", "camera_path": "../there/poses.txt"}
    (here / "poses.txt").touch()
    assert read_config(Path("../there/run.toml"))["camera_path"] == "poses.txt"
