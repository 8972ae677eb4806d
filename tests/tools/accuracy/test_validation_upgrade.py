"""What Mitsuba 3 would read otherwise in older files is written out."""

from pathlib import Path

import pytest

from tools.accuracy.validation_upgrade import written_out


def test_only_shapes_whose_files_are_missing_are_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "here.obj").touch()
    ball = '<shape type="sphere"/>'
    here, gone = (
        f'<shape type="obj"><string name="filename" value="{name}"/></shape>' for name in ("here.obj", "gone.obj")
    )
    assert written_out(ball + here + ball + gone + ball, tmp_path) == ball + here + ball + ball
    assert capsys.readouterr().out == "left out: gone.obj\n"


def test_numbers_are_white_and_colours_of_srgb_linear(tmp_path: Path) -> None:
    assert written_out('<spectrum name="a" value="2"/>', tmp_path) == '<rgb name="a" value="2, 2, 2"/>'
    assert written_out('<spectrum name="a" value="1, 2 3"/>', tmp_path) == '<rgb name="a" value="1, 2, 3"/>'
    for grey in ('<srgb name="a" value="#bcbcbc"/>', '<srgb name="a" value="0.737255, 0.737255, 0.737255"/>'):
        values = written_out(grey, tmp_path).split('value="')[1].rstrip('"/>').split(", ")
        assert [float(value) for value in values] == pytest.approx([0.5029] * 3, abs=1e-4)
