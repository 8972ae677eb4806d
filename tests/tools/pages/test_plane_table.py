"""The page on planes says what the table says."""

from pathlib import Path

from clsim.frames import ALL_PLANES, EMISSION
from tools.pages.plane_table import text

PAGE = Path(__file__).parents[3] / "docs" / "planes.md"


def test_the_page_on_planes_is_current() -> None:
    assert PAGE.read_text() == text(), "run: python tools/pages/plane_table.py docs/planes.md"


def test_every_channel_is_on_the_page() -> None:
    page = PAGE.read_text()
    for channel in ALL_PLANES + EMISSION:
        assert f"`{channel}`" in page, channel
