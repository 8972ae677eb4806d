from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from clsim.frames import Frame
from tests.live.view.view_events import random_events

pytest.importorskip("rerun", reason="rerun is an extra")

from clsim.live.view.rerun import RerunSink
from tests.events.event_data import end_of


class Listener:
    """Hears what is logged, and lets it pass on to rerun."""

    def __init__(self, recording: Any) -> None:
        self.recording, self.logged = recording, Counter[str]()

    def log(self, name: str, *data: Any, **options: Any) -> None:
        self.logged[name] += 1
        self.recording.log(name, *data, **options)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.recording, name)


def test_rerun_shows_a_picture_as_soon_as_its_time_is_over(tmp_path: Path) -> None:
    events = random_events(100, 32, 24, end_us=30_000)
    sink = RerunSink("a test", 32, 24, save_to=str(tmp_path / "events.rrd"))
    heard = sink._recording = Listener(sink._recording)
    sink.write(events, int(events["t"][0]) + 32_999)
    assert "events" not in heard.logged
    sink.write(events[:0], int(events["t"][0]) + 33_000)
    assert heard.logged["events"] == 1
    sink.close()


def test_rerun_takes_events_rates_cloud_and_frames(tmp_path: Path) -> None:
    path = tmp_path / "events.rrd"
    events = random_events(3000, 32, 24, end_us=200_000)
    sink = RerunSink("a test", 32, 24, save_to=str(path))
    heard = sink._recording = Listener(sink._recording)
    for start in range(0, len(events), 100):
        sink.write(events[start : start + 100], end_of(events[start : start + 100]))
    frame = Frame(np.ones((3, 24, 32), np.float32), ("R", "G", "B"), time_us=5)
    assert sink.wants_frame()
    sink.show_frame(frame, np.zeros((24, 32), np.float32))
    assert not sink.wants_frame()
    sink.close()
    pictures = int(events["t"][-1] - events["t"][0]) // 33_000
    names = ("events", "cloud", "rate/on", "rate/off")
    assert heard.logged == dict.fromkeys(names, pictures) | {"frame/noisy": 1, "frame/denoised": 1}
    assert path.stat().st_size > 10_000
