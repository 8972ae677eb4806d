"""Any footage by its name: a video, a folder or a glob pattern of pictures."""

from __future__ import annotations

import glob
from pathlib import Path

from clsim.footage.images import ENDINGS, Pictures
from clsim.footage.source import Footage, Reading
from clsim.footage.video import Video

VIDEO_ENDINGS = (
    ".mp4", ".mkv", ".mov", ".webm", ".avi", ".m4v", ".gif", ".mpg", ".mpeg", ".ts", ".flv", ".wmv", ".ogv", ".apng",
)  # fmt: skip
FILE_ENDINGS = (*VIDEO_ENDINGS, *ENDINGS)
"""Endings by which files are known as video or pictures, where they could be something else."""


def is_footage(name: str) -> bool:
    """Tell whether ``name`` is a video or pictures, rather than EXR frames; of what is not there its ending tells."""
    base = Path(name)
    if not base.is_dir() and not glob.has_magic(name):
        return base.suffix.lower() not in ("", ".exr")
    found = [str(file) for file in base.iterdir()] if base.is_dir() else glob.glob(name)
    endings = {Path(file).suffix.lower() for file in found}
    return ".exr" not in endings and bool(endings & set(ENDINGS))


def open_footage(name: str, reading: Reading) -> Footage:
    """Open a video, or the pictures of a folder or glob pattern.

    Raises:
        InputError: it cannot be read.
    """
    path = Path(name)
    several = path.is_dir() or glob.has_magic(name) or path.suffix.lower() in ENDINGS
    kind = Pictures if several else Video
    return kind(name, reading)
