"""The whole line: a scene in, events out."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import clsim
from clsim.events import SinkError
from clsim.events.files import open_source
from clsim.live.options import LiveOptions
from clsim.live.session import open_live
from clsim.score import score

SIZE = (64, 48)


def events_of(scene: str, **options: object) -> np.ndarray:
    settings = {"method": "esim-ad", "resolution": SIZE, "frame_count": 24, "fps": 60.0, "spp": 8} | options
    return np.concatenate(list(clsim.stream(scene, **settings)))


def command(*arguments: object, **options: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "clsim", *map(str, arguments)], capture_output=True, text=True, timeout=120, **options
    )


def test_a_still_scene_fires_nothing() -> None:
    assert len(events_of("still")) == 0


def test_independent_noise_fires_in_a_still_scene() -> None:
    assert len(events_of("still", noise="independent", frame_count=6, method="esim")) > 0


@pytest.mark.slow
def test_moving_shadows_are_found() -> None:
    """The radiance gate sees shadows; ΔR, whose inputs are first-hit features, is blind to them (method.md §3)."""
    truth = events_of("moving-light", method="wlr-esim", spp=64, seed=1)
    recall = {
        gate: score(events_of("moving-light", gate=gate), truth, *SIZE, fps=60.0).recall
        for gate in ("radiance", "delta-r")
    }
    assert recall["radiance"] >= 0.6
    assert recall["delta-r"] < 0.2


@pytest.mark.slow
def test_a_box_over_a_uniform_wall_fires_at_its_leading_edge() -> None:
    """Where the wall was uniform, ΔR knows nothing of what arrives; features that leave their range open the gate."""
    found = events_of("uniform-wall")
    truth = events_of("uniform-wall", method="wlr-esim", spp=32, seed=1)
    blind = events_of("uniform-wall", gate="delta-r")
    assert score(found, truth, *SIZE, fps=60.0).recall > 0.9
    assert len(blind) < len(found)


@pytest.mark.parametrize("rule", ["interpolated", pytest.param("frame", marks=pytest.mark.slow)])
def test_runs_and_thread_counts_are_bit_identical(rule: str) -> None:
    runs = [events_of("two-boxes", frame_count=8, event_rule=rule, threads=threads) for threads in (1, 2, 2)]
    assert len(runs[0]) > 100
    for run in runs[1:]:
        assert run.tobytes() == runs[0].tobytes()
    assert events_of("two-boxes", frame_count=8, event_rule=rule, seed=1).tobytes() != runs[0].tobytes()


def test_batches_are_sorted_and_inside_the_run() -> None:
    found = events_of("two-boxes", frame_count=8)
    order = np.lexsort((found["x"], found["y"], found["t"]))
    assert (order == np.arange(len(found))).all()
    assert found["t"].min() > 0 and found["t"].max() <= round(7e6 / 60)
    assert found["x"].max() < SIZE[0] and found["y"].max() < SIZE[1]


def test_files_are_written_alike_twice_and_have_sidecars(tmp_path: Path) -> None:
    """The second time, text goes to standard output; the first time, that has the summary."""
    options = ("--resolution", "32x24", "--frame-count", "6", "--fps", "60", "--seed", "3")
    once, again = (
        command("live", "cornell", *options, "--out", tmp_path / f"{name}.aedat4", *more)
        for name, more in (("a", ("--out", tmp_path / "a.txt", "--json")), ("b", ("--out", "-")))
    )
    assert once.returncode == again.returncode == 0, once.stderr + again.stderr
    assert (tmp_path / "a.aedat4").read_bytes() == (tmp_path / "b.aedat4").read_bytes()
    events = [line for line in (tmp_path / "a.txt").read_text().splitlines() if not line.startswith("#")]
    assert again.stdout.splitlines() == events and all(len(line.split()) == 4 for line in events)
    binary, text = (np.concatenate(list(open_source(tmp_path / name))) for name in ("a.aedat4", "a.txt"))
    assert len(binary) > 0 and (binary == text).all()
    about = json.loads((tmp_path / "a.aedat4.json").read_text())
    assert about["complete"] and about["clsim_version"] == clsim.__version__
    assert about["options"]["seed"] == 3 and about["options"]["probe_spp"] == 1
    assert about["thresholds"] == {"on": 0.2, "off": 0.2}
    assert about["camera"]["intrinsics_px"]["cx"] == 16
    assert about["poses"] == "a.aedat4.poses.txt" and len((tmp_path / about["poses"]).read_text().splitlines()) == 2 + 6
    summary = json.loads(once.stdout)
    needed = {"frames", "events", "solved_share", "dropped_frames", "wall_s", "cpu_s", "simulated_s"}
    assert needed <= set(summary) and summary["frames"] == 6 and summary["simulated_s"] == round(5 / 60, 6)
    assert summary["events"] == about["summary"]["events"] == len(binary)


@pytest.mark.parametrize(
    ("more", "asked"),
    [
        ((), signal.SIGINT),
        pytest.param((), signal.SIGTERM, id="terminated"),
        pytest.param((), signal.SIGHUP, marks=pytest.mark.slow, id="terminal closed"),
        pytest.param(("--frames",), signal.SIGINT, marks=pytest.mark.slow, id="frames"),
    ],
)
def test_an_interrupt_ends_within_a_second_with_readable_files(
    tmp_path: Path, more: tuple[str, ...], asked: signal.Signals
) -> None:
    if more:
        pytest.importorskip("dv_processing", reason="frames beside events need the dv extra")
    out = tmp_path / "events.aedat4"
    arguments = ["live", "two-boxes", "--resolution", "64x48", "--loop", "--json", "--out", str(out), *more]
    run = subprocess.Popen(
        [sys.executable, "-m", "clsim", *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        deadline = time.monotonic() + 60
        while (not out.exists() or out.stat().st_size < 20_000) and time.monotonic() < deadline:
            time.sleep(0.05)
        run.send_signal(asked)
        stdout, stderr = run.communicate(timeout=30)
    finally:
        run.kill()
    assert run.returncode == 130, stderr
    summary = json.loads(stdout)
    assert summary["interrupted"] and summary["events"] > 0
    assert len(np.concatenate(list(open_source(out)))) == summary["events"]
    about = json.loads(out.with_name("events.aedat4.json").read_text())
    assert about["complete"] is False and about["summary"]["events"] == summary["events"]


def test_an_interrupt_ends_within_a_second_though_nobody_reads(tmp_path: Path) -> None:
    """A full pipe stalls the run; the file beside it is completed all the same, with all that was counted."""
    out = tmp_path / "events.aedat4"
    arguments = ["live", "two-boxes", "--resolution", "64x48", "--quality", "draft", "--loop", "--threshold", "0.02"]
    run = subprocess.Popen(
        [sys.executable, "-m", "clsim", *arguments, "--out", "-", "--out", str(out)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        poses, seen, deadline = tmp_path / "events.aedat4.poses.txt", 0, time.monotonic() + 100
        while time.monotonic() < deadline:  # until no frame adds its pose any longer
            time.sleep(1.0)
            lines = poses.read_text().count("\n") if poses.exists() else 0
            if lines == seen > 3:
                break
            seen = lines
        begun = time.monotonic()
        run.send_signal(signal.SIGINT)
        run.wait(20)
        took_s = time.monotonic() - begun
    finally:
        run.kill()
    assert run.returncode == 130
    assert took_s < 2.5, "a second to stop, and what the interpreter takes to end"
    about = json.loads((tmp_path / "events.aedat4.json").read_text())
    assert about["complete"] is False
    assert len(clsim.open(out).read()) == about["summary"]["events"] > 0
    broken, whole = about["summary"]["outputs"]
    assert "takes no more events" in broken["error"] and "error" not in whole


def test_a_run_is_repeated_from_its_sidecar(tmp_path: Path) -> None:
    again = {"outputs": [str(tmp_path / "b.aedat4")]}
    given = {"resolution": (32, 24), "frame_count": 5, "fps": 60.0, "quality": "accurate", "spp": 6, "seed": 4}
    open_live(LiveOptions("cornell", **given, outputs=(str(tmp_path / "a.aedat4"),))).run()
    about = json.loads((tmp_path / "a.aedat4.json").read_text())
    summary = open_live(LiveOptions.from_dict(about["options"] | again)).run()
    assert (tmp_path / "a.aedat4").read_bytes() == (tmp_path / "b.aedat4").read_bytes()
    assert summary.events == about["summary"]["events"] > 0
    assert (tmp_path / "a.aedat4.poses.txt").read_text() == (tmp_path / "b.aedat4.poses.txt").read_text()


def test_a_run_tells_of_an_output_that_failed(tmp_path: Path) -> None:
    class Full:
        def write(self, events: np.ndarray, end_us: int) -> None:
            raise SinkError("full.txt: no space left")

        def close(self) -> None:
            pass

    kept = tmp_path / "kept.npz"
    options = LiveOptions("still", resolution=(16, 12), frame_count=2, outputs=(str(kept),))
    with pytest.raises(SinkError, match=r"^full.txt: no space left$"):
        open_live(options, extra_sinks=(Full(),)).run()
    about = json.loads(kept.with_name("kept.npz.json").read_text())
    assert about["complete"] and about["summary"]["frames"] == 2 and len(about["summary"]["outputs"]) == 2


def test_an_interrupted_run_does_not_call_its_file_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    session = open_live(LiveOptions("still", resolution=(16, 12), frame_count=2, outputs=(str(tmp_path / "a.npz"),)))

    def interrupted() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(session.pipeline, "wait", interrupted)
    with pytest.raises(KeyboardInterrupt):
        session.run()
    assert json.loads((tmp_path / "a.npz.json").read_text())["complete"] is False


def test_processor_time_counts_processes_that_a_run_begins(tmp_path: Path) -> None:
    class Busy:
        """A sink that works in a process of its own."""

        def write(self, events: np.ndarray, end_us: int) -> None:
            pass

        def close(self) -> None:
            script = "import time\nwhile time.process_time() < 1.5: pass"
            subprocess.run([sys.executable, "-c", script], check=True)

    options = LiveOptions("still", resolution=(16, 12), frame_count=2, quality="draft")
    session = open_live(options, extra_sinks=(Busy(),))
    before_s = time.process_time()
    summary = session.run()
    assert summary.cpu_s >= 1.5 and time.process_time() - before_s < summary.cpu_s - 1.2


@pytest.mark.slow
@pytest.mark.parametrize(("built", "begun"), [("wp_headers_*", False), ("wp_make_cached*", True)])
def test_an_interrupt_while_kernels_are_built(tmp_path: Path, built: str, begun: bool) -> None:
    """Or while their headers are, when no output is open yet."""
    caches = {"WARP_CACHE_PATH": tmp_path / "warp", "POCL_CACHE_DIR": tmp_path / "pocl", "XDG_CACHE_HOME": tmp_path}
    (tmp_path / "pocl").mkdir()
    out = tmp_path / "events.txt"
    run = subprocess.Popen(
        [sys.executable, "-m", "clsim", "live", "cornell", "--out", str(out)],
        env=os.environ | {name: str(path) for name, path in caches.items()},
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        deadline = time.monotonic() + 60
        while not any((tmp_path / "warp").rglob(built)) and time.monotonic() < deadline:
            time.sleep(0.02)
        run.send_signal(signal.SIGINT)
        _, stderr = run.communicate(timeout=60)
    finally:
        run.kill()
    assert run.returncode == 130, stderr
    # Depending on how far it was, it had not begun ("interrupted") or tells what it has ("stopped: 0 events").
    assert "interrupted" in stderr or "stopped: 0 events" in stderr
    assert (out.read_text() == "") if begun else not out.exists()


def test_stopping_to_iterate_ends_the_run() -> None:
    batches = clsim.stream("two-boxes", resolution=(32, 24), loop=True)
    assert len([next(batches) for _ in range(3)]) == 3
    batches.close()
    import threading

    assert not [thread for thread in threading.enumerate() if thread.name.startswith("clsim-")]


def test_an_output_that_fails_is_told_when_the_stream_has_ended(tmp_path: Path) -> None:
    lost, kept = tmp_path / "lost.txt", tmp_path / "kept.txt"
    yielded = 0
    with pytest.raises(SinkError, match=r"lost.txt: writing failed \(the file or its folder was deleted meanwhile\)"):
        for batch in clsim.stream(
            "two-boxes", resolution=(32, 24), spp=2, frame_count=20, outputs=(str(lost), str(kept))
        ):
            lost.unlink(missing_ok=True)
            yielded += len(batch)
    assert yielded == len(np.concatenate(list(open_source(kept)))) > 0


@pytest.mark.slow
def test_memory_does_not_grow() -> None:
    """Resident memory grows by less than 2.5 MB in 900 frames, once the motion and all light have been seen."""
    script = """
import sys, clsim
def resident_kb():
    return int(next(l for l in open("/proc/self/status") if l.startswith("VmRSS")).split()[1])
for k, _ in enumerate(clsim.stream("two-boxes", resolution=(64, 48), loop=True, spp=2)):
    if k == 300:
        before = resident_kb()
    if k == 1200:
        print(resident_kb() - before)
        break
"""
    outcome = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=290)
    assert outcome.returncode == 0, outcome.stderr
    assert int(outcome.stdout) < 2.5 * 1024
