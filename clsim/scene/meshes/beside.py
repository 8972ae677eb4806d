"""Files that lie beside a mesh: libraries of materials and images, as trimesh asks for them."""

from __future__ import annotations

import codecs
import io
import os
import re
from pathlib import Path

from clsim.errors import InputError
from clsim.scene.files import asset_file

MAX_FILE_BYTES = 1 << 30
_IMAGE_OPTIONS = re.compile(r"(?:-(?:[ost](?:\s+[-+.\deE]+){1,3}|mm\s+\S+\s+\S+|[a-z]+\s+\S+)\s+)+")
"""What may stand before the name of an image: ``-s`` and its like with one to three numbers, others with a word."""


class FolderResolver:
    """Gives trimesh the files beside the mesh and no others; trimesh swallows errors here, so they are kept.

    Attributes:
        refused: why a file may not be read.
        lacking: which files are missing or damaged, and what that means.
        left_out: what of images is not done.
        known: names of the materials that were found.
    """

    def __init__(self, folder: Path, libraries: list[str]) -> None:
        """Give the files of a folder, of libraries those whose names are told."""
        self.folder = folder
        self.refused: list[str] = []
        self.lacking: list[str] = []
        self.left_out: list[str] = []
        self.known: set[str] = set()
        self._libraries = libraries

    def get(self, name: str) -> bytes:
        """Return an image's bytes."""
        from PIL import Image

        options = _IMAGE_OPTIONS.match(name)
        if options is not None:
            name = name[options.end() :]
            self.left_out.append(f"the options of the image {name} are left out ({options[0].strip()})")
        data = self._bytes(name, "image", "its material has no texture")
        try:
            Image.open(io.BytesIO(data))
        except Exception:
            self.lacking.append(f"the image {name} cannot be decoded; its material has no texture")
            raise
        return data

    def __getitem__(self, first: str) -> bytes:
        """Return all libraries of materials: a file may name several, of which trimesh asks for the first line's."""
        found = b"\n".join(as_utf8(self._library(name)) for line in self._libraries for name in self._names(line))
        # One number stands for three.
        found = re.sub(rb"(?mi)^([ \t]*K[ades][ \t]+)([-+.\de]+)[ \t\r]*$", rb"\1\2 \2 \2", found)
        if re.search(rb"(?mi)^[ \t]*K[de][ \t]+(?:spectral|xyz)\b", found):
            self.left_out.append("colours of materials by a spectrum or in XYZ are left out")
        self.known |= {name.strip().decode() for name in re.findall(rb"(?m)^\s*newmtl[ \t]+(.+)$", found)}
        return found

    def _names(self, line: str) -> list[str]:
        """Return the names in a line, in which spaces part names or belong to one."""
        several = line.split()
        if len(several) == 1 or os.path.isfile(self.folder / line):
            return [line]
        return several if all(name.lower().endswith(".mtl") for name in several) else [line]

    def _library(self, name: str) -> bytes:
        try:
            return self._bytes(name, "material library", "its materials are grey")
        except OSError:
            return b""

    def _bytes(self, name: str, kind: str, consequence: str) -> bytes:
        try:
            file = asset_file(name, self.folder)
            if not file.is_file():  # a name in another encoding than UTF-8 was decoded for trimesh
                file = asset_file(os.fsdecode(name.encode("latin-1", "ignore")), self.folder)
            if file.is_file() and file.stat().st_size > MAX_FILE_BYTES:
                raise InputError(f"{name!r} is larger than {MAX_FILE_BYTES >> 30} GiB")
        except InputError as error:
            self.refused.append(str(error))
            raise
        try:
            return file.read_bytes()
        except OSError as error:
            self.lacking.append(f"the {kind} {name} cannot be read ({error.strerror}); {consequence}")
            raise


def as_utf8(data: bytes) -> bytes:
    """Return text as UTF-8 without a mark; what is none is taken for Latin-1, in which every byte is a letter."""
    data = data.removeprefix(codecs.BOM_UTF8)
    if b"\n" not in data:
        data = data.replace(b"\r", b"\n")  # as old Macs end lines
    try:
        data.decode()
    except UnicodeDecodeError:
        return data.decode("latin-1").encode()
    return data
