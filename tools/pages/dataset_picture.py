"""The picture of docs/datasets.md: ten samples of a bundled specification.

python tools/pages/dataset_picture.py flow docs/images/dataset.png
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

from clsim.datasets.preview import preview
from clsim.datasets.spec import load_spec


def main(spec: str, target: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        told = preview(load_spec(spec), Path(folder), None, longest_s=3600.0)
        shutil.copy(told.sheet, target)
    print(told.as_dict())


if __name__ == "__main__":
    main(*sys.argv[1:])
