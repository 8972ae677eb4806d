"""``--frames``: what dv-processing finds in the file, whatever becomes of the run."""

import json
import re
import subprocess
import sys
import textwrap
from pathlib import Path

import aedat
import faery
import numpy as np
import pytest

from clsim.events import EVENT_DTYPE, SinkError
from clsim.events.files import open_source
from clsim.events.formats.aedat4 import Aedat4Sink
from clsim.events.formats.filesink import FlushPolicy
from clsim.events.formats.frame_recorder import FrameRecorder
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
    outputs = {Path(each["name"]).name: each for each in json.loads(outcome.stdout)["outputs"]}
    assert outputs["a.aedat4"]["recorded_frames"] == 6 and outputs["a.aedat4"]["exposure"] > 0
    assert dv.io.MonoCameraRecording(str(path)).getStreamNames() == ["events", "frames"]  # poses are in the sidecar
    assert set(aedat.Decoder(path).id_to_stream()) == {0, 1}  # which a pose stream would make it refuse
    with faery.aedat.Decoder(path) as decoder:
        packets = [packet for track, packet in decoder if track.data_type == "events"]
    assert rows(np.concatenate(packets), ("t", "x", "y", "on")) == rows(alone, ("t", "x", "y", "on"))


def test_frames_are_srgb_of_one_exposure_in_dvs_order(tmp_path: Path) -> None:
    path = tmp_path / "a.aedat4"
    recorder = FrameRecorder(Aedat4Sink(path, WIDTH, HEIGHT, FlushPolicy(), frames=True))
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
    from clsim.events.formats.aedat4 import Aedat4Sink
    from clsim.events.formats.filesink import FlushPolicy

    if sys.argv[2:]:
        resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), int(sys.argv[2])))
    sink = Aedat4Sink(Path(sys.argv[1]), {WIDTH}, {HEIGHT}, FlushPolicy(), frames=True)
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


@pytest.mark.parametrize("at_step", [3, 30, 301])
def test_a_kill_leaves_what_was_flushed(tmp_path: Path, at_step: int) -> None:
    path = tmp_path / "a.aedat4"
    with subprocess.Popen([sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        steps = 0
        while steps < at_step:
            steps = int(process.stdout.readline())
        process.kill()
        told = [int(line) for line in process.stdout if line.strip().isdigit()]
    steps = told[-1] if told else steps
    events, frames = recording(path)
    assert np.array_equal(events["timestamp"], np.arange(len(events)))  # in order, without a gap
    assert [time_us for time_us, _ in frames] == [200 * (k + 1) for k in range(len(frames))]
    assert len(events) >= 200 * steps and len(frames) >= steps


@pytest.mark.parametrize(
    ("trouble", "cause"),
    [("full disk", "File too large"), ("vanished folder", "the file or its folder was deleted meanwhile")],
)
def test_a_failing_medium_is_one_clear_error(tmp_path: Path, trouble: str, cause: str) -> None:
    path = tmp_path / "a.aedat4"
    arguments = [sys.executable, "-c", WRITER, str(path), *(["100000"] if trouble == "full disk" else [])]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stderr is not None
        for _ in range(10):
            process.stdout.readline()
        if trouble == "vanished folder":
            path.unlink()
        _, stderr = process.communicate(timeout=60)
    assert re.search(rf"SinkError: {re.escape(str(path))}: writing failed \({cause}\)", stderr), stderr
    if trouble == "full disk":  # what fitted is whole
        events, frames = recording(path)
        assert np.array_equal(events["timestamp"], np.arange(len(events))) and len(frames) > 10


def test_a_failed_recorder_stays_failed_and_closes_quietly(tmp_path: Path) -> None:
    path = tmp_path / "a.aedat4"
    sink = Aedat4Sink(path, WIDTH, HEIGHT, FlushPolicy(), frames=True)
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    sink.write_image(0, image)
    path.unlink()
    with pytest.raises(SinkError, match="deleted meanwhile"):
        sink.write_image(1, image)
    with pytest.raises(SinkError, match="cannot be written any more"):
        sink.write_image(2000, image)
    sink.close()
    sink.close()


def test_an_image_of_another_shape_is_refused(tmp_path: Path) -> None:
    sink = Aedat4Sink(tmp_path / "a.aedat4", WIDTH, HEIGHT, FlushPolicy(), frames=True)
    with pytest.raises(ValueError, match="expected 8 bits"):
        sink.write_image(0, np.zeros((WIDTH, HEIGHT, 3), np.uint8))
    sink.close()
