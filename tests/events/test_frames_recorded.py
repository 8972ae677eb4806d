"""``--frames``: what dv-processing finds in the file, whatever becomes of its writer."""

import json
import os
import re
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import aedat
import faery
import numpy as np
import pytest

from clsim.errors import InputError
from clsim.events import EVENT_DTYPE, SinkError
from clsim.events.aedat4_frames import Aedat4FramesSink
from clsim.events.files import open_source
from clsim.events.frame_recorder import FrameRecorder
from clsim.frames import Frame

dv = pytest.importorskip("dv_processing", reason="frames beside events need the dv extra")

WIDTH, HEIGHT = 32, 24
FPS = 60.0


def recording(path: Path) -> tuple[np.ndarray, list[tuple[int, np.ndarray]]]:
    """Return the events and the frames that dv-processing finds."""
    reader = dv.io.MonoCameraRecording(str(path))
    assert reader.getEventResolution() == reader.getFrameResolution() == (WIDTH, HEIGHT)
    batches, frames = [], []
    while (batch := reader.getNextEventBatch()) is not None:
        batches.append(batch.numpy())
    while (frame := reader.getNextFrame()) is not None:
        frames.append((frame.timestamp, frame.image.copy()))
    return np.concatenate(batches) if batches else np.empty(0), frames


def rows(events: np.ndarray, names: tuple[str, ...]) -> list[tuple[int, ...]]:
    return list(zip(*(events[name].tolist() for name in names), strict=True))


def test_dv_processing_reads_events_and_frames(tmp_path: Path) -> None:
    path, text = tmp_path / "a.aedat4", tmp_path / "a.txt"
    run = ("live", "cornell", "--resolution", f"{WIDTH}x{HEIGHT}", "--frame-count", "6", "--fps", FPS)
    words = [*run, "--frames", "--out", path, "--out", text, "--json"]
    outcome = subprocess.run(
        [sys.executable, "-m", "clsim", *map(str, words)], capture_output=True, text=True, timeout=120
    )
    assert outcome.returncode == 0, outcome.stderr
    (alone,) = (np.concatenate(list(source)) for source in [open_source(text)])
    events, frames = recording(path)
    assert rows(events, ("timestamp", "x", "y", "polarity")) == rows(alone, ("t", "x", "y", "on")) != []
    assert (np.concatenate(list(open_source(path))) == alone).all()  # ours skips the frames
    assert [time_us for time_us, _ in frames] == [round(k * 1e6 / FPS) for k in range(6)]
    assert all(image.shape == (HEIGHT, WIDTH, 3) and image.std() > 10 for _, image in frames)
    assert not np.array_equal(frames[0][1], frames[-1][1])
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["a.aedat4", "a.aedat4.json", "a.txt", "a.txt.json"]
    outputs = {Path(each["name"]).name: each for each in json.loads(outcome.stdout)["outputs"]}
    assert outputs["a.aedat4"]["recorded_frames"] == 6 and outputs["a.aedat4"]["exposure"] > 0
    assert dv.io.MonoCameraRecording(str(path)).getStreamNames() == ["events", "frames"]  # poses are in the sidecar
    assert set(aedat.Decoder(path).id_to_stream()) == {0, 1}  # which a pose stream would make it refuse
    with faery.aedat.Decoder(path) as decoder:
        packets = [packet for track, packet in decoder if track.data_type == "events"]
    assert rows(np.concatenate(packets), ("t", "x", "y", "on")) == rows(alone, ("t", "x", "y", "on"))


def test_frames_are_srgb_of_one_exposure_in_dvs_order(tmp_path: Path) -> None:
    path = tmp_path / "a.aedat4"
    recorder = FrameRecorder(Aedat4FramesSink(path, WIDTH, HEIGHT))
    for time_us, red, green, blue in ((0, 0.0, 0.0, 0.0), (10, 2.0, 1.0, 0.5), (20, 1.0, 0.5, 0.25)):
        planes = np.ones((4, HEIGHT, WIDTH), np.float32)
        planes[1:] = np.array([red, green, blue])[:, None, None]
        recorder.record(Frame(planes, ("Depth", "R", "G", "B"), time_us), np.empty(0, EVENT_DTYPE))
    recorder.close()
    _, frames = recording(path)
    assert recorder.report()["exposure"] == pytest.approx(0.4)  # the brightest channel, 2.0, becomes 0.8

    def srgb(linear: float) -> int:
        return round(255 * (1.055 * linear ** (1 / 2.4) - 0.055))

    pixels = [image[3, 5].tolist() for _, image in frames]
    expected = [[0, 0, 0], [srgb(0.2), srgb(0.4), srgb(0.8)], [srgb(0.1), srgb(0.2), srgb(0.4)]]
    assert np.abs(np.array(pixels) - expected).max() <= 1  # blue, green, red


WRITER = textwrap.dedent(
    f"""
    import resource, sys, time
    import numpy as np
    from pathlib import Path
    from clsim.events import EVENT_DTYPE
    from clsim.events.aedat4_frames import Aedat4FramesSink

    if sys.argv[2:]:
        resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), int(sys.argv[2])))
    sink = Aedat4FramesSink(Path(sys.argv[1]), {WIDTH}, {HEIGHT})
    print(sink.writer_pid, flush=True)
    for k in range(100_000):
        batch = np.zeros(200, EVENT_DTYPE)
        batch["t"] = np.arange(200 * k, 200 * k + 200)
        batch["x"] = batch["t"] % {WIDTH}
        sink.write(batch, 200 * (k + 1))
        sink.write_image(200 * (k + 1), np.full(({HEIGHT}, {WIDTH}, 3), k % 256, np.uint8))
        print(k + 1, flush=True)
        time.sleep(0.001)
    """
)


@pytest.mark.parametrize("killed", ["ours", "both"])
@pytest.mark.parametrize("at_step", [30, 301])
def test_a_kill_leaves_what_was_flushed(tmp_path: Path, killed: str, at_step: int) -> None:
    path = tmp_path / "a.aedat4"
    with subprocess.Popen([sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        writer = int(process.stdout.readline())
        steps = 0
        while steps < at_step:
            steps = int(process.stdout.readline())
        if killed == "both":
            while path.stat().st_size < 20_000:  # it has begun
                time.sleep(0.005)
            os.kill(writer, signal.SIGKILL)
        process.kill()
        told = [int(line) for line in process.stdout if line.strip().isdigit()]
    steps = told[-1] if told else steps
    deadline = time.monotonic() + 30
    while Path(f"/proc/{writer}").exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    events, frames = recording(path)
    assert np.array_equal(events["timestamp"], np.arange(len(events)))  # in order, without a gap
    assert [time_us for time_us, _ in frames] == [200 * (k + 1) for k in range(len(frames))]
    if killed == "ours":  # the writer outlives us and completes the file
        assert len(events) >= 200 * steps and len(frames) >= steps
    else:
        assert len(events) > 0 and len(frames) > 0


@pytest.mark.parametrize("trouble", ["full disk", "vanished folder", "killed writer"])
def test_a_failing_medium_is_one_clear_error(tmp_path: Path, trouble: str) -> None:
    """dv-processing aborts its process at a full disk; ours must not notice but by an error."""
    folder = tmp_path / "folder"
    folder.mkdir()
    path = folder / "a.aedat4"
    arguments = [sys.executable, "-c", WRITER, str(path), *(["100000"] if trouble == "full disk" else [])]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stderr is not None
        writer = int(process.stdout.readline())
        for _ in range(10):
            process.stdout.readline()
        if trouble == "vanished folder":
            path.unlink()
        elif trouble == "killed writer":
            os.kill(writer, signal.SIGKILL)
        _, stderr = process.communicate(timeout=60)
    cause = {
        "full disk": "File too large",
        "vanished folder": "the file or its folder was deleted meanwhile",
        "killed writer": "dv-processing's writer ended with status -9",
    }[trouble]
    assert re.search(rf"SinkError: {re.escape(str(path))}: writing failed \({cause}\)", stderr), stderr


def test_a_failed_recorder_stays_failed_and_closes_quietly(tmp_path: Path) -> None:
    sink = Aedat4FramesSink(tmp_path / "a.aedat4", WIDTH, HEIGHT)
    os.kill(sink.writer_pid, signal.SIGKILL)
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    with pytest.raises(SinkError, match="status -9"):
        for k in range(1000):
            sink.write_image(k, image)
            time.sleep(0.01)
    with pytest.raises(SinkError, match="cannot be written any more"):
        sink.write_image(2000, image)
    sink.close()
    sink.close()


def test_without_dv_processing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"`frames` needs dv-processing; install it with: pip install 'clsim\[dv\]'"):
        Aedat4FramesSink(tmp_path / "a.aedat4", WIDTH, HEIGHT)
    assert list(tmp_path.iterdir()) == []
