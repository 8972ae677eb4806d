"""What a run tells at its end."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from clsim.cli.output.summary import _hint
from clsim.live.session import Session


def hint(fps: float = 100.0, **told: Any) -> str | None:
    summary = {"steep_pixels": 0, "frames": 1, "events": 10, "most_crossings": 0, "outputs": []} | told
    return _hint(cast(Session, SimpleNamespace(schedule=SimpleNamespace(fps=fps))), summary)


@pytest.mark.parametrize(("crossings", "fps"), [(3, "100"), (4, "200"), (6, "200"), (7, "300")])
def test_the_rate_that_is_advised_leaves_three_crossings_a_step(crossings: int, fps: str) -> None:
    """At so many times the frames each has so many times fewer crossings."""
    assert f"--fps {fps} places events" in str(hint(steep_pixels=3, most_crossings=crossings))
    assert "--fps" not in str(hint(steep_pixels=2, most_crossings=crossings)), "a fifth of the events is not many"


def test_how_to_look_at_events_is_told_of_files_that_were_written(tmp_path: Path) -> None:
    there, failed = str(tmp_path / "a.raw"), str(tmp_path / "b.raw")
    for name in (there, failed):
        Path(name).touch()
    outputs = [{"name": failed, "error": "full"}, {"name": "tcp://127.0.0.1:1"}, {"name": there}]
    assert hint(outputs=outputs) == f"to look at it: clsim view {there}"
    assert hint(outputs=outputs, events=0) is None
    assert hint() == "to keep the events: --out events.aedat4"
