"""Wrong input gives one clear sentence and status 2, and leaves nothing half-written behind."""

import socket
from collections.abc import Callable
from pathlib import Path

import pytest
import trimesh

SMALL = ("--resolution", "16x12", "--frame-count", "2")
TWICE = ["{}/events.txt"] * 2


@pytest.fixture
def files(tmp_path: Path) -> Path:
    (tmp_path / "unknown_key.toml").write_text("[camera]\nfov = 50\nposition = [0, 0, 3]\nlook_at = [0, 0, 0]\n")
    (tmp_path / "not.toml").write_text("= =")
    (tmp_path / "nan.obj").write_text("v 0 0 0\nv 1 0 0\nv nan 1 0\nf 1 2 3\n")
    (tmp_path / "empty.ply").write_text("")
    glb = trimesh.creation.box().export(file_type="glb")
    (tmp_path / "cut.glb").write_bytes(glb[: len(glb) // 2])
    (tmp_path / "readonly").write_text("a file, not a folder")
    (tmp_path / "events.txt").write_text("7474 23 16 1\n" * 50)
    (tmp_path / "frames").mkdir()
    (tmp_path / "earlier").mkdir()
    (tmp_path / "earlier" / "between-000001.npz").touch()
    (tmp_path / "many_rays.toml").write_text("first_hit_rays = 100000\n")
    (tmp_path / "probes.toml").write_text("probe_spp = 99\n")
    (tmp_path / "each_second.toml").write_text("probe_every = 2\n")
    (tmp_path / "ring.toml").write_text('ring = "drop-oldest"\n')
    return tmp_path


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["live", "two-boxs"], "no scene 'two-boxs': did you mean two-boxes?"),
        (["live", "{}/missing.toml"], "missing.toml: no such file"),
        (["convert", "a" * 300 + ".txt", "{}/out.txt"], "File name too long"),
        (["info", "a" * 300 + ".exr"], "File name too long"),
        (["detect", "a" * 300, "--out", "{}/out.txt"], "File name too long"),
        (["live", "{}/unknown_key.toml"], "fov"),
        (["live", "{}/not.toml"], "not.toml"),
        (["live", "{}/nan.obj"], "nan.obj"),
        (["live", "{}/empty.ply"], "empty.ply"),
        (["live", "{}/cut.glb"], "cut.glb"),
        (["live", "still", "--threshold", "-0.2"], "--threshold must be one or two positive numbers"),
        (["live", "still", "--threshold=0"], "--threshold must be one or two positive numbers"),
        (["live", "still", "--resolution", "0x10"], "--resolution must be WIDTHxHEIGHT"),
        (["live", "still", "--duration", "-1s"], "--duration must be a positive time"),
        (
            ["live", "still", "--duration", "200", "ms"],
            "(ms); write a time and its unit as one word, such as 200ms",
        ),
        (["live", "still", "--duration", "2", "min"], "(min); write a time and its unit as one word, such as 200min"),
        (["live", "still", "--duration", "1e-9s", "--out", "{}/x.txt"], "--duration must be at least half a frame"),
        (["view", "missing.raw", "--view"], "missing.raw: cannot be read"),
        (["detect", "missing", "--out", "{}/x.txt"], "missing: no such file or folder"),
        (["live", "still", "--fps", "x"], "clsim: --fps must be a number, got 'x'\n"),
        (["live", "still", "--spp", "1.5"], "clsim: --spp must be a whole number, got '1.5'\n"),
        (
            ["live", "still", "--quality", "acurate"],
            "clsim: --quality must be one of draft, balanced, accurate, exact, published, got 'acurate'; "
            "did you mean accurate?\n",
        ),
        (["bench", "edge", "--fps", "0.5"], "clsim: --fps must be greater than or equal to 1, got '0.5'\n"),
        (["bench", "edge", "--time", "x"], "clsim: --time must be one of auto, fixed, adaptive and lambda=PIXELS"),
        (["bench", "x"], "clsim: No such command 'x', expected one of tradeoff, throughput, edge\n"),
        (["dataset", "flow", "--count", "-1"], "clsim: --count must be greater than or equal to 1, got '-1'\n"),
        (["live", "still", "--out", "{}/frames"], "frames is a folder, expected a file for events"),
        (["live", "still", "--out", "{}/a.foo"], ".bag; or name the format with --format"),
        (["live", "still", "--fps", "0"], "--fps must be a positive number, got 0"),
        (["live", "still", "--spp", "0"], "--spp must be at least 1, got 0"),
        (["live", "still", "--spp", "1000000000"], "--spp must be at most 1048576, got 1000000000"),
        (["live", "still", "--config", "{}/many_rays.toml"], "`first_hit_rays` must be at most 4096, got 100000"),
        (
            ["live", "still", "--fps", "1e-320"],
            "--fps must be at least 1e-12, for times end at 1e+12 s, got 9.99989e-321",
        ),
        (["live", "--view", "webb", "still"], "--view must be one of web, terminal, rerun, none, got 'webb'"),
        (["live", "still", "--view", "webb"], "--view must be one of web, terminal, rerun, none, got 'webb'"),
        (["view", "a.raw", "--colors", "pink"], "--colours must be one of blue-orange, purple-green, violet-yellow, "),
        (["live", "still", "--fps", "2e6"], "--fps must be at most 1000000, for times are whole µs, got 2e+06"),
        (
            ["live", "still", "--quality", "exact", "--sampling", "adaptive"],
            "--sampling adaptive needs `first_hit_rays` of at least 1, which --quality exact has not: give it too",
        ),
        (
            ["live", "still", "--quality", "exact", "--config", "{}/probes.toml"],
            "`probe_spp` 99 is for --sampling adaptive",
        ),
        (
            ["live", "still", "--quality", "accurate", "--config", "{}/probes.toml"],
            "`probe_spp` must be at most --spp 32, got 99",
        ),
        (
            ["live", "still", "--method", "esim", "--config", "{}/each_second.toml"],
            "`probe_every` 2 needs `first_hit_rays` of at least 1, got 0",
        ),
        (["live", "still", "--quality", "balanced", "--noise", "independent"], "adaptive needs --noise common"),
        (["live", "still", "--window", "12"], "--window must be an odd number from 3 to 21, got 12"),
        (["live", "still", "--history", "9"], "--history must be from 1 to 5 frames, got 9"),
        (["live", "still", "--gate", "published"], "--gate must be one of radiance, delta-r, got 'published'"),
        (["live", "still", "--seed", "-1"], "--seed must not be negative, got -1"),
        (["live", "still", "--config", "{}/ring.toml"], "`ring` drop-oldest needs --pace real"),
        (["live", "still", "--frame-count", "3", "--duration", "1s"], "--frame-count and --duration"),
        (["live", "still", "--render-device", "cuda:99"], "cuda:99"),
        (["live", "still", "--opencl", "no such device"], "no such device"),
        (["live", "still", *SMALL, "--out", "{}/nowhere/x.aedat4"], "nowhere"),
        (["live", "still", *SMALL, "--out", "{}/readonly/x.txt"], "readonly"),
        (["live", "still", *SMALL, "--out", "{}/x.mov"], 'the ending ".mov" is no known event format'),
        (["live", "still", *SMALL, "--out", "gopher://127.0.0.1:70"], "gopher"),
        (["live", "still", *SMALL, "--out", "tcp://127.0.0.1:99999"], "99999"),
        (["live", "still", *SMALL, "--json", "--out", "-"], "--json and --out - would both write"),
        (["live", "still", *SMALL, "--json", "--out", "-?format=aedat4"], "--json and --out - would both write"),
        (["detect", "{}/frames", "--json", "--out", "-?format=aedat4"], "--json and --out - would both write"),
        (["live", "still", *SMALL, "--frames", "--out", "{}/x.txt"], "--frames go into an AEDAT4 file"),
        (["live", "still", *SMALL, "--frames", "--out", "-?format=aedat4"], "--frames go into an AEDAT4 file"),
        (["live", "still", *SMALL, "--text-time", "s", "--out", "{}/x.es"], "--text-time is for text"),
        (["live", "still", *SMALL, "--format", "evt9", "--out", "{}/x.raw"], '--format "evt9" is unknown'),
        (["live", "still", *SMALL, "--format", "evt2", "--out", "-"], "--format is for files"),
        (["detect", "{}/frames", "--text-time", "s", "--out", "{}/x.es"], "--text-time is for text"),
        (["convert", "{}/a.txt", "{}/x.es", "--text-time", "s"], "--text-time is for text"),
        (["convert", "{}/a.txt", "{}/x.dsec"], "x.dsec: is a layout of truth"),
        (["live"], "which scene?"),
        (["detect"], "which frames?"),
        (["detect", "{}/frames"], "where shall the events go?"),
        (["live", "still", "--no-such-option"], "--no-such-option"),
        (["detect", "{}/frames", "--out", "{}/x.txt"], "no EXR file"),
        (["detect", "{}/frames", "--fps", "0", "--out", "{}/x.txt"], "--fps must be a positive number, got 0"),
        (["render", "still", "--out", "{}/readonly"], "readonly"),
        (["render", "still", "--times", "adaptive", "--out", "{}/earlier"], "earlier holds files between-NNNNNN.npz"),
        (["bench", "throughput", "--opencl", "no such device"], "no such device"),
        (
            ["render", "still", "--out", "{}/new", "--times", "{}/t.txt", "--time-tolerance", "1ms"],
            "--time-tolerance is for --times adaptive",
        ),
        *(
            (["render", "still", "--out", "{}/new", "--times", "{}/t.txt", f"--{option}", "2"], f"leave out --{option}")
            for option in ("fps", "duration", "frame-count")
        ),
        (["score", "{}/a.aedat4", "{}/b.aedat4", "--resolution", "4x4", "--fps", "60"], "a.aedat4"),
        (["score", *TWICE, "--fps", "0", "--resolution", "99x99"], "--fps must be a positive number, got 0"),
        (["score", *TWICE, "--fps", "60", "--resolution", "99x99", "--tau", "nan"], "--tau must be a positive number"),
        (["detect", "{}/events.txt", "--out", "{}/x.txt"], "events.txt: holds text, expected a video"),
        (["info", "nothing"], "no scene 'nothing'"),
    ],
    ids=lambda value: " ".join(value)[:60] if isinstance(value, list) else "",
)
def test_one_sentence_and_status_2(
    clsim: Callable[..., object], files: Path, arguments: list[str], expected: str
) -> None:
    before = set(files.rglob("*"))
    outcome = clsim(*[argument.replace("{}", str(files)) for argument in arguments])
    assert outcome.status == 2, outcome.stderr
    assert expected in outcome.stderr
    assert outcome.stderr.startswith("clsim: ") and "Traceback" not in outcome.stderr
    assert len(outcome.stderr.strip().splitlines()) == 1, outcome.stderr
    assert set(files.rglob("*")) == before


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("--pose-rate 100", "pose_rate = 100"),
        ("--imu-rate=1e3", "imu_rate = 1e3"),
        ("--imu-noise imu.yaml", 'imu_noise = "imu.yaml"'),
        ("--no-follow-specular", "follow_specular = false"),
        ("--no-governor", "governor = false"),
        ("--follow-specular --loop", "follow_specular = true"),
        ("--ring", "ring = …"),
    ],
)
def test_what_was_an_option_says_what_to_write_now(clsim: Callable[..., object], words: str, line: str) -> None:
    outcome = clsim("live", "still", *words.split())
    name = words.split("=")[0].split()[0]
    said = f"clsim: {name} is a key of a --config file now, such as run.toml: {line}\n"
    assert (outcome.status, outcome.stderr) == (2, said)


def test_without_a_command_there_is_help_and_nothing_else(clsim: Callable[..., object]) -> None:
    outcome = clsim("sensor")
    assert outcome.status == 2 and outcome.stderr == "" and "Usage: clsim sensor" in outcome.stdout


def test_every_wrong_key_is_named_at_once(clsim: Callable[..., object], tmp_path: Path) -> None:
    scene = tmp_path / "two.toml"
    scene.write_text("color = 1\n[camera]\nfov = 3\n")
    outcome = clsim("live", scene)
    assert outcome.status == 2 and "color" in outcome.stderr and "fov" in outcome.stderr


def test_a_port_in_use(clsim: Callable[..., object]) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        outcome = clsim("live", "still", *SMALL, "--out", f"tcp://127.0.0.1:{port}")
    assert outcome.status == 2 and str(port) in outcome.stderr
    assert len(outcome.stderr.strip().splitlines()) == 1


def test_no_output_is_left_when_a_later_one_cannot_be_opened(clsim: Callable[..., object], tmp_path: Path) -> None:
    outcome = clsim("live", "still", *SMALL, "--out", tmp_path / "a.txt", "--out", tmp_path / "no" / "b.txt")
    assert outcome.status == 2
    assert list(tmp_path.iterdir()) == []
