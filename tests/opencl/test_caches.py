"""Where kernels are kept where the user's cache cannot be written."""

import os
import tempfile
import warnings
from pathlib import Path

import pytest

from clsim import caches
from clsim.caches import cache_folder, prepare_caches
from clsim.errors import InputError, Notice

VARIABLES = ("XDG_CACHE_HOME", "WARP_CACHE_PATH", "POCL_CACHE_DIR", "PYOPENCL_CACHE_DIR")


@pytest.fixture
def closed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A path below which nobody can make a folder, and an empty folder for temporary files."""
    for variable in VARIABLES:
        monkeypatch.setenv(variable, "")  # so that what is set meanwhile is undone
        monkeypatch.delenv(variable)
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    (tmp_path / "file").write_text("no folder")
    caches._prepare.cache_clear()
    return tmp_path / "file" / "home"


def spare(tmp_path: Path) -> Path:
    return tmp_path / "temporary" / f"clsim-cache-{os.getuid()}"


def test_a_home_that_cannot_be_written_is_told_once(
    closed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(closed))
    with pytest.warns(Notice, match=f"{closed}/.cache cannot be written.*kept in {spare(tmp_path)}; set XDG"):
        folder = cache_folder()
    assert folder == spare(tmp_path) / "clsim" and folder.is_dir()
    assert spare(tmp_path).stat().st_mode & 0o777 == 0o700
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert cache_folder() == folder
    # The next run finds what is there.
    monkeypatch.delenv("XDG_CACHE_HOME")
    with pytest.warns(Notice):
        caches._prepare.cache_clear()
        assert cache_folder() == folder


@pytest.mark.parametrize("variable", VARIABLES[1:])
def test_a_folder_that_is_asked_for_and_cannot_be_is_told(
    closed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, variable: str
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "good"))
    monkeypatch.setenv(variable, str(closed))
    with pytest.warns(Notice, match=f"{closed} cannot be written.*set {variable} to") as said:
        prepare_caches()
    assert len(said) == 1 and Path(os.environ[variable]).parent == spare(tmp_path)
    assert os.environ["XDG_CACHE_HOME"] == str(tmp_path / "good")


def test_a_folder_of_one_compiler_that_cannot_be_written_moves_all(
    closed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "good").mkdir()
    (tmp_path / "good" / "pocl").write_text("of somebody else")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "good"))
    with pytest.warns(Notice, match="XDG_CACHE_HOME"):
        prepare_caches()
    assert os.environ["XDG_CACHE_HOME"] == str(spare(tmp_path))


def test_a_user_without_a_home_has_a_cache(closed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)
    with pytest.warns(Notice, match="a user without a home"):
        assert cache_folder().parent == spare(tmp_path)


def test_kernels_that_somebody_else_could_change_are_not_taken(
    closed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(closed))
    (tmp_path / "theirs").mkdir()
    spare(tmp_path).symlink_to(tmp_path / "theirs")
    with pytest.warns(Notice):
        folder = cache_folder()
    assert folder.is_dir() and folder.parent.parent == tmp_path / "temporary" and folder.parent != spare(tmp_path)
    assert not list((tmp_path / "theirs").iterdir())


def test_where_nothing_can_be_written_a_sentence_says_so(
    closed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(closed))
    monkeypatch.setattr(tempfile, "tempdir", str(closed))
    with pytest.raises(InputError, match=f"kernels cannot be kept: neither {closed}/.cache nor a temporary folder"):
        prepare_caches()
