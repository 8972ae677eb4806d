"""Text files that users name: what is wrong with one is told in a sentence, by all who read them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from clsim import values
from clsim.errors import InputError
from clsim.scene.pbrt.tokens import Tokens
from clsim.scene.toml.scene import read_toml
from clsim.scene.trajectories.trajectory import read_tum
from clsim.truth.imu_file import read_imu_noise

READERS: dict[str, Callable[[Path], object]] = {
    "pbrt": lambda path: Tokens(path).take(),
    "toml": read_toml,
    "trajectory": read_tum,
    "imu": lambda path: read_imu_noise(str(path)),
}


@pytest.mark.parametrize("reader", READERS)
def test_what_is_no_text_or_not_there(tmp_path: Path, reader: str) -> None:
    file = tmp_path / "a"
    file.write_bytes(b"seven \xff")
    with pytest.raises(InputError, match=r"a: is not UTF-8 text \(byte 6\)$"):
        READERS[reader](file)
    with pytest.raises(InputError, match=r"b: cannot be read \(No such file or directory\)$"):
        READERS[reader](tmp_path / "b")
    with pytest.raises(InputError, match=r"cannot be read \(Is a directory\)$"):
        READERS[reader](tmp_path)


def test_size_is_bounded_to_the_byte(tmp_path: Path) -> None:
    file = tmp_path / "a"
    file.write_bytes(b"1\r\n2" * (1 << 18))
    assert values.read_text(file, 1 << 20, "a song") == "1\n2" * (1 << 18)
    with file.open("ab") as more:
        more.write(b"!")
    with pytest.raises(InputError, match=r"^`song`: is larger than 1 MiB, expected a song$"):
        values.read_text(file, 1 << 20, "a song", "`song`")
