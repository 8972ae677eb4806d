"""Camera paths from files, and by chance."""

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import clsim
from clsim.errors import InputError
from clsim.live.options import LiveOptions
from clsim.live.stages import plan_stages
from clsim.scene import load_world
from clsim.scene.motion import Nested, Orbit, compose, rotation_matrix
from clsim.scene.rigid import quaternion_of
from clsim.scene.trajectories.paths import ENDINGS, read_path
from clsim.scene.trajectories.wandering import Shake, Wander
from tests.scene.gltf.gltf_files import gltf, with_camera, write_gltf
from tests.scene.odd_zips import repack

TIMES_S = np.array([0.5, 0.75, 1.5])
QUATERNIONS = np.array([[0.0, 0.0, 0.0, 1.0], [0.0, 0.6, 0.0, 0.8], [0.36, 0.48, 0.64, 0.48]])
POSITIONS = np.array([[0.0, 1.0, 2.0], [0.5, 1.0, 2.0], [0.5, -1.0, 2.5]])
POSES = np.array([compose(p, rotation_matrix(q)) for p, q in zip(POSITIONS, QUATERNIONS, strict=True)])
HALF_TURN = np.diag([1.0, -1.0, -1.0, 1.0])
ROWS = np.column_stack([TIMES_S, POSITIONS, QUATERNIONS])


def lines(rows: np.ndarray, separator: str) -> str:
    return "".join(separator.join(repr(float(value)) for value in row) + "\n" for row in rows)


def write(path: Path) -> Path:
    """Write the poses in the format that the file's name asks for."""
    kind = path.name
    if kind == "path.txt":
        path.write_text("# a comment\n" + lines(ROWS, " "))
    elif kind == "esim.csv":
        comments = "# timestamp, x, y, z, qx, qy, qz, qw\n  # of a simulator\n"
        path.write_text(comments + lines(ROWS * [1e9, *[1] * 7], ","))
    elif kind in ("euroc.csv", "states.csv"):
        t, p, q = ROWS[:, :1] * 1e9, ROWS[:, 1:4], ROWS[:, [7, 4, 5, 6]]
        names = [f"p_RS_R_{axis} [m]" for axis in "xyz"] + [f"q_RS_{axis} []" for axis in "wxyz"]
        if kind == "euroc.csv":
            path.write_text(",".join(["#timestamp [ns]", *names]) + "\n" + lines(np.hstack([t, p, q]), ","))
        else:
            names = ["#timestamp", *names, *(f"v_RS_R_{axis} [m s^-1]" for axis in "xyz")]
            path.write_text("# states\n" + ", ".join(names) + "\n" + lines(np.hstack([t, p, q, p]), ","))
    elif kind == "header.csv":
        swapped = np.roll(ROWS * [1e6, *[1] * 7], 1, axis=1)
        path.write_text("q_w,timestamp [us],p_x,p_y,p_z,q_x,q_y,q_z\n" + lines(swapped, ","))
    elif kind in ("poses.npz", "rows.npz"):  # the last row of a pose says nothing, and may be left out
        poses = POSES[:, :3] if kind == "rows.npz" else POSES
        np.savez(path, time_us=np.round(TIMES_S * 1e6).astype(np.int64), poses=poses)
    elif kind == "places.npz":
        np.savez(path, time_s=TIMES_S, positions=POSITIONS, quaternions=QUATERNIONS)
    return path


NAMES = ["path.txt", "esim.csv", "euroc.csv", "states.csv", "header.csv", "poses.npz", "rows.npz", "places.npz"]


@pytest.mark.parametrize("name", NAMES)
def test_every_format_tells_the_same_path(tmp_path: Path, name: str) -> None:
    for axes, turn in (("opencv", HALF_TURN), ("opengl", np.eye(4))):
        motion = read_path(write(tmp_path / name), axes=axes)  # type: ignore[arg-type]
        assert motion.duration_s == pytest.approx(1.0)
        for time_s, pose in zip(TIMES_S, POSES, strict=True):
            assert motion.pose(time_s - 0.5) == pytest.approx(pose @ turn, abs=1e-9)
    assert motion.pose(0.125)[0, 3] == pytest.approx(0.25), "straight between two poses"
    bent = read_path(tmp_path / name, interpolation="cubic")
    assert bent.pose(0.25)[:3, 3] == pytest.approx(POSITIONS[1])
    assert bent.pose(0.5)[1, 3] != pytest.approx(motion.pose(0.5)[1, 3], abs=1e-3)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.csv", "x,y,z\n1,2,3\n", r"a.csv:1: its columns are x, y, z, expected x, y, z, qx"),
        ("a.csv", "t,x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n", "its columns are t, x, .* a time with its unit"),
        ("a.csv", "time,x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n", "a time with its unit"),
        ("a.csv", "t_s,x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,0\n", r"a.csv:2: got '0,0.*', expected 8 finite numbers"),
        ("a.csv", "0,0,0,0,0,0,0,nan\n", "expected 8 finite numbers"),
        ("a.csv", "0,0,0,0,0,0,0,2\n", "its quaternion has length 2, expected 1"),
        ("a.csv", "5,0,0,0,0,0,0,1\n5,0,0,0,0,0,0,1\n", r"a.csv:2: time 5e-09 s does not come after"),
        ("a.csv", "0,0,0,0,0,0,0,1\n0.5,0,0,0,0,0,0,1\n", r"a.csv:2: time 0.5 has no unit, and is none in ns"),
        ("a.csv", "0,0,0,0,0,0,0,1\n9,0,0,0,0,0,0,1\n", r"a.csv:2: time 9 has no unit, and is none in ns.* time_s,x,y"),
        ("a.csv", "0,0,0,0,0,0,0,1\n1e300,0,0,0,0,0,0,1\n", r"a.csv:2: time 1e\+291 is no time in seconds"),
        ("a.csv", "#time,x,y,z,qx,qy,qz,qw\n.5,0,0,0,0,0,0,1\n", r"a.csv:2: time 0.5 has no unit"),
        ("a.csv", "", "a.csv: has no poses"),
        ("a.npz", "no", "a.npz: is no npz of arrays"),
        ("a.mov", "", r"a.mov: ends in .mov, expected a camera path: .txt"),
        ("a.txt", "0 0 0\n", r"a.txt:1: got '0 0 0', expected 8 numbers"),
    ],
)
def test_what_is_no_path_is_told(tmp_path: Path, name: str, text: str, message: str) -> None:
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_path(path)


@pytest.mark.parametrize("kind", ["a.csv", "a.npz", "a.txt"])
def test_times_since_1970_keep_their_nanoseconds(tmp_path: Path, kind: str) -> None:
    """Float64 would be off by up to 120 ns, and the acceleration of what goes evenly by centimetres per second²."""
    times_ns = 1_403_636_579_763_555_584 + 5_000_000 * np.arange(8)
    places = [[k * 0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0] for k in range(8)]
    path = tmp_path / kind
    if kind == "a.npz":
        np.savez(path, t_ns=times_ns, positions=np.array(places)[:, :3], quaternions=np.array(places)[:, 3:])
    else:
        seconds = [f"{t // 10**9}.{t % 10**9:09}" for t in times_ns.tolist()]
        told, gap = (seconds, " ") if kind == "a.txt" else (map(str, times_ns), ",")
        path.write_text("".join(gap.join([t, *map(str, place)]) + "\n" for t, place in zip(told, places, strict=True)))
    motion = read_path(path)
    assert motion.times_s == tuple(k * 5_000_000 / 1e9 for k in range(8))


def test_a_spline_of_turns_that_runs_away_is_told(tmp_path: Path) -> None:
    """SciPy finds it step by step, and after some turns by almost 180° with numbers that are none."""
    rng = np.random.default_rng(0)
    times_s, turns = np.cumsum(rng.uniform(1e-3, 1.0, 12)), rng.standard_normal((12, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    path = tmp_path / "a.txt"
    path.write_text(lines(np.column_stack([times_s, np.zeros((12, 3)), turns]), " "))
    read_path(path)
    with pytest.raises(InputError, match=r"keyframes turn by up to 1\d\d° from one to the next"):
        read_path(path, interpolation="cubic")


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"poses": POSES}, "holds poses, expected one array of times with its unit"),
        ({"time_s": TIMES_S, "t_us": TIMES_S, "poses": POSES}, "expected one array of times"),
        ({"time_s": TIMES_S[:2], "poses": POSES}, r"time_s has shape \(2,\), expected 3"),
        ({"time_s": TIMES_S}, "expected poses, or positions and quaternions"),
        ({"time_s": TIMES_S, "poses": POSES[0]}, "expected n × 4 × 4"),
        ({"time_s": TIMES_S, "poses": 0 * POSES}, r"poses\[0\] is no rotation and position"),
        ({"time_s": TIMES_S, "poses": np.swapaxes(POSES, 1, 2)}, r"poses\[.\] has its position in the last row"),
        ({"time_s": TIMES_S, "positions": POSITIONS, "quaternions": POSITIONS}, "expected n × 3 and n × 4"),
        ({"time_s": np.array([object()]), "poses": POSES}, "is no npz of arrays"),
    ],
)
def test_arrays_that_are_no_path_are_told(tmp_path: Path, arrays: dict[str, np.ndarray], message: str) -> None:
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(InputError, match=message):
        read_path(tmp_path / "a.npz")


@pytest.mark.parametrize(("method", "flags"), [(99, 0), (0, 1)], ids=["a method unknown", "a password"])
def test_an_npz_that_python_cannot_unpack_is_told(tmp_path: Path, method: int, flags: int) -> None:
    np.savez(tmp_path / "a.npz", time_s=TIMES_S, poses=POSES)
    repack(tmp_path / "a.npz", method, flags)
    with pytest.raises(InputError, match=r"a\.npz: is no npz of arrays \("):
        read_path(tmp_path / "a.npz")


@given(st.sampled_from([".txt", ".csv", ".npz"]), st.binary(max_size=80))
def test_hostile_files_get_one_sentence(tmp_path_factory: pytest.TempPathFactory, suffix: str, data: bytes) -> None:
    path = tmp_path_factory.getbasetemp() / f"hostile{suffix}"
    path.write_bytes(data)
    try:
        read_path(path)
    except InputError as error:
        assert "\n" not in str(error)


def test_a_small_file_that_unpacks_to_a_large_one_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("clsim.scene.trajectories.paths.MAX_BYTES", 1 << 20)
    np.savez_compressed(tmp_path / "bomb.npz", time_s=np.zeros(200_000))
    assert (tmp_path / "bomb.npz").stat().st_size < 1 << 12
    with pytest.raises(InputError, match="unpacks to more than 1 MiB"):
        read_path(tmp_path / "bomb.npz")


def test_a_run_follows_a_file_and_writes_it_again(tmp_path: Path) -> None:
    np.savez(
        tmp_path / "path.npz", time_s=[0.0, 0.05], positions=[[0, 1, 3], [0.5, 1, 3]], quaternions=[[1, 0, 0, 0]] * 2
    )
    out = str(tmp_path / "a.npz")
    options: dict[str, object] = {"resolution": (16, 12), "method": "esim", "spp": 1, "outputs": out}
    with clsim.stream("two-boxes", camera_path=tmp_path / "path.npz", **options) as run:
        first = np.concatenate(list(run))
    times_us, poses = run.poses
    assert times_us[-1] == 50_000, "it lasts as long as the path"
    assert poses[3, :3, 3] == pytest.approx([0.25, 1.0, 3.0]) and poses[3, :3, :3] == pytest.approx(np.eye(3))
    shutil.move(f"{out}.poses.txt", tmp_path / "again.txt")
    with clsim.stream("two-boxes", camera_path=tmp_path / "again.txt", **options) as run:
        assert len(np.concatenate(list(run))) == pytest.approx(len(first), abs=2)
    about = json.loads(Path(f"{out}.json").read_text())["options"]
    assert about["camera_path"] == str(tmp_path / "again.txt")
    assert LiveOptions.from_dict(about).camera_path == about["camera_path"]


def test_a_still_model_on_a_path_does_not_drift(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    world = plan_stages(LiveOptions(str(tmp_path / "a.obj"), camera_path=str(write(tmp_path / "poses.npz")))).world
    assert world.camera.motion.pose(0.25) == pytest.approx(POSES[1] @ HALF_TURN) and world.duration_s == 1.0
    assert not any("circles" in note for note in world.notes)


def test_a_path_of_one_pose_lasts_as_long_as_the_scene(tmp_path: Path) -> None:
    (tmp_path / "path.txt").write_text("5 1 2 3 0 0 0 1\n")
    world, own = load_world("two-boxes", camera_path=tmp_path / "path.txt"), load_world("two-boxes")
    assert world.duration_s == own.duration_s > 0
    np.testing.assert_allclose(world.camera.motion.pose(0.5), compose((1, 2, 3), np.eye(3)) @ HALF_TURN, atol=1e-12)
    scene = tmp_path / "scene.toml"
    keys = "keyframes = [{{ time_s = 0.0, position = [0, 0, 3] }}, {{ time_s = {}, position = [1, 0, 3] }}]\n"
    scene.write_text(f'[camera]\n{keys.format(6.0)}[[objects]]\nshape = "box"\n{keys.format(1.5)}')
    assert load_world(scene).duration_s == 6.0
    assert load_world(scene, camera_path=tmp_path / "path.txt").duration_s == 1.5, "its own way is not gone"
    scene.write_text(f"duration_s = 3.0\n{scene.read_text()}")
    assert load_world(scene, camera_path=tmp_path / "path.txt").duration_s == 3.0


def test_the_camera_of_a_gltf_can_be_followed(tmp_path: Path) -> None:
    tree = with_camera(gltf())
    file = write_gltf(tmp_path, tree)
    expected = read_path(file).pose(0.0)
    assert expected[2, 3] == 30.0
    del tree["nodes"][0]["mesh"]
    assert (read_path(write_gltf(tmp_path, tree)).pose(0.0) == expected).all(), "it needs no mesh"
    with pytest.raises(InputError, match="has no camera"):
        read_path(write_gltf(tmp_path, gltf()))


def test_wandering_is_smooth_repeatable_and_within_reach() -> None:
    path = Wander(seed=3, duration_s=40.0, reach_m=(0.2, 0.0, 0.4), reach_deg=(30.0, 0.0, 0.0), poses_per_s=5.0)
    times_s = np.linspace(0.0, 40.0, 8_001)
    poses = np.array([path.pose(float(t)) for t in times_s])
    assert (np.abs(poses[:, :3, 3]) <= (0.2, 1e-12, 0.4)).all()
    angles = np.degrees(np.arctan2(poses[:, 2, 1], poses[:, 1, 1]))
    assert np.abs(angles).max() <= 30.0 + 1e-9
    # A uniform variable's variance is 1/3; the squares of the quintic basis sum to .393 in the mean.
    share = np.sqrt(0.393 / 3)
    assert poses[:, 0, 3].std() == pytest.approx(0.2 * share, rel=0.15)
    assert angles.std() == pytest.approx(30.0 * share, rel=0.15)
    speeds = np.diff(poses[:, :3, 3], axis=0) / 0.005
    assert 0.1 < np.abs(speeds).max() < 2.0 and np.abs(np.diff(speeds, axis=0)).max() < 0.1, "no jump in speed"
    assert (Wander(seed=3, duration_s=4.0).pose(1.0) == Wander(seed=3, duration_s=4.0).pose(1.0)).all()
    assert (Wander(seed=4, duration_s=4.0).pose(1.0) != Wander(seed=3, duration_s=4.0).pose(1.0)).any()


def test_a_shake_has_its_deviation_and_frequencies() -> None:
    shake = Shake(seed=1, sigma_m=0.01, sigma_deg=1.0, lowest_hz=4.0, highest_hz=8.0)
    times_s = np.arange(0.0, 100.0, 0.01)
    poses = np.array([shake.pose(float(t)) for t in times_s])
    assert poses[:, :3, 3].std(axis=0) == pytest.approx([0.01] * 3, rel=0.15)
    turns = np.degrees([poses[:, 2, 1], poses[:, 0, 2], poses[:, 1, 0]])
    assert turns.std(axis=1) == pytest.approx([1.0] * 3, rel=0.15)
    power = np.abs(np.fft.rfft(poses[:, 0, 3])) ** 2
    hz = np.fft.rfftfreq(len(times_s), 0.01)
    assert power[(hz > 3.9) & (hz < 8.1)].sum() > 0.99 * power.sum()


def test_a_scene_can_ask_for_both(tmp_path: Path) -> None:
    scene = tmp_path / "a.toml"
    scene.write_text(
        "[camera]\norbit = { center = [0.0, 0.0, 0.0], radius_m = 2.0, period_s = 4.0 }\n"
        "wander = { seed = 5, duration_s = 6.0 }\nshake = { sigma_deg = 0.5 }\n"
        "[environment]\nradiance = [1.0, 1.0, 1.0]\n"
    )
    motion = clsim.load_scene(scene).camera.motion
    orbit = Orbit((0.0, 0.0, 0.0), 2.0, 4.0, target=(0.0, 0.0, 0.0))
    expected = Nested(Nested(orbit, Wander(seed=5, duration_s=6.0)), Shake(sigma_deg=0.5))
    assert motion.pose(1.3) == pytest.approx(expected.pose(1.3)) and motion.duration_s == 6.0
    assert quaternion_of(motion.pose(1.3)[:3, :3]) != quaternion_of(orbit.pose(1.3)[:3, :3])


def test_what_cannot_wander_is_told() -> None:
    with pytest.raises(InputError, match="needs a duration and poses a second above 0"):
        Wander(duration_s=0.0)
    with pytest.raises(InputError, match="frequencies must be above 0 and in order, got 9 and 3 Hz"):
        Shake(lowest_hz=9.0, highest_hz=3.0)


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_pipe_is_not_waited_for(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"path{ending}"
    os.mkfifo(path)
    with pytest.raises(InputError, match="is no ordinary file, expected a camera path"):
        read_path(path)


@pytest.mark.parametrize(("unit", "per_s"), [("s", 1), ("sec", 1), ("ms", 10**3), ("us", 10**6), ("ns", 10**9)])
@pytest.mark.parametrize("ending", [".csv", ".npz"])
def test_times_count_in_the_unit_that_their_name_ends_in(tmp_path, ending, unit, per_s):
    """Three metres in a second and a half, whatever the clock; time starts at the first pose."""
    times = [5 * per_s, 5 * per_s + per_s * 3 // 2 if per_s > 1 else 6.5]
    path = tmp_path / f"a{ending}"
    if ending == ".csv":
        rows = [f"{time},{x},0,0,0,0,0,1" for time, x in zip(times, (0, 3), strict=True)]
        path.write_text("\n".join([f"timestamp_{unit},x,y,z,qx,qy,qz,qw", *rows]) + "\n")
    else:
        places = {"positions": [(0, 0, 0), (3, 0, 0)], "quaternions": [(0, 0, 0, 1)] * 2}
        np.savez(path, **{f"time_{unit}": times}, **places)
    motion = read_path(path)
    assert motion.duration_s == pytest.approx(1.5)
    assert motion.pose(0.5)[:3, 3] == pytest.approx((1, 0, 0))


@pytest.mark.parametrize("prefix", ["", "p", "t", "p_", "t_"])
def test_columns_of_places_have_the_names_that_programs_give_them(tmp_path: Path, prefix: str) -> None:
    header = ",".join(["time_s", *(prefix + axis for axis in "xyz"), "qx", "qy", "qz", "qw"])
    (tmp_path / "a.csv").write_text(header + "\n0,1,2,3,0,0,0,1\n")
    np.testing.assert_array_equal(read_path(tmp_path / "a.csv").pose(0.0)[:3, 3], (1, 2, 3))
