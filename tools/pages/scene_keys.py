"""Write docs/reference/scene-keys.md: every key that a scene's TOML may hold.

python -m tools.pages.scene_keys docs/reference/scene-keys.md
"""

from __future__ import annotations

import sys
from pathlib import Path

from clsim.scene.toml.schema import key_table

INTRODUCTION = """# Keys of a scene file

All that a scene's `.toml` may hold; [scenes](../scenes.md) shows how. Unknown keys are errors. Lengths are metres,
times seconds, angles degrees, colours linear Rec. 709, radiance W·sr⁻¹·m⁻².
"""


def text() -> str:
    """Return the whole page."""
    return f"{INTRODUCTION}\n{key_table().strip().replace('### ', '## ')}\n"


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(text())
