"""Where the sidecar of an output goes."""

from __future__ import annotations

import os
from pathlib import Path

from clsim.live.outputs import sidecar_path


def test_files_have_a_sidecar_and_what_is_no_file_has_none(tmp_path: Path) -> None:
    there = tmp_path / "there.csv"
    there.touch()
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    assert sidecar_path(str(there)) == tmp_path / "there.csv.json"
    assert sidecar_path(str(tmp_path / "new.aedat4")) == tmp_path / "new.aedat4.json"
    for name in (str(pipe), "/dev/null", "-", "tcp://127.0.0.1:7777"):
        assert sidecar_path(name) is None, name
