"""Films on textures: which picture is shown when, from files and from videos."""

import numpy as np
import PIL.Image
import pytest
from hypothesis import given
from hypothesis import strategies as st

from clsim.errors import InputError
from clsim.scene import load_world
from clsim.scene.pictures.film import Files, Film, Video
from clsim.scene.pictures.images import PixelBudget, decode_srgb

SCENE = """
[camera]
position = [0.0, 0.0, 2.0]
[materials.screen]
{kind} = {{ {table} }}
emission = [4.0, 4.0, 4.0]
[[objects]]
shape = "quad"
material = "screen"
"""


class Greys:
    """Pictures of one grey each; they remember which were read."""

    def __init__(self, *greys):
        self.greys, self.count, self.asked = greys, len(greys), []

    def read(self, number):
        self.asked.append(number)
        return np.full((2, 3, 4), self.greys[number], np.uint8)


def write_pictures(folder, *greys, size=(4, 2)):
    folder.mkdir(exist_ok=True)
    for k, grey in enumerate(greys):
        PIL.Image.new("RGB", size, (grey,) * 3).save(folder / f"shot_{k + 8}.png")


def write_video(path, greys, fps=50, size=(64, 48)):
    av = pytest.importorskip("av")
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=fps)
        stream.width, stream.height, stream.bit_rate = *size, 4_000_000
        stream.pix_fmt = "yuv420p"
        for grey in greys:
            frame = av.VideoFrame.from_ndarray(np.full((size[1], size[0], 3), grey, np.uint8), format="rgb24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def film_of(folder, table, kind="emission_texture"):
    file = folder / "scene.toml"
    file.write_text(SCENE.format(kind=kind, table=table))
    world = load_world(file)
    ((name, film),) = world.films()
    assert name == "screen" and world.light_changes()
    return world, film


def test_each_picture_is_shown_until_the_next():
    film = Film(Greys(10, 20, 30), 50.0, loop=False)
    times_s = (0.0, 0.0199, 0.02, 0.05, 9.0)
    assert [film.shown(t, t) for t in times_s] == [[(0, 1)], [(0, 1)], [(1, 1)], [(2, 1)], [(2, 1)]]
    assert film.duration_s == pytest.approx(0.06)
    again = Film(Greys(10, 20, 30), 50.0, loop=True)
    assert [again.shown(t, t)[0][0] for t in (0.06, 0.08, 1.0)] == [0, 1, 2]
    assert again.duration_s == 0.0
    assert (film.least_fps, Film(Greys(10), 50.0, loop=True).least_fps) == (50, 0), "one picture alone misses nothing"


def test_times_of_frames_that_are_rounded_show_the_next_picture():
    film = Film(Greys(*range(200)), 60.0, loop=False)
    assert [film.shown(t, t)[0][0] for t in (round(k * 1e6 / 60) * 1e-6 for k in range(0, 200, 3))] == [
        *range(0, 200, 3)
    ]


@given(st.floats(0.0, 2.0), st.floats(1e-4, 0.5), st.booleans())
def test_an_exposure_sees_each_picture_for_its_share(start_s, length_s, loop):
    greys = np.random.default_rng(1).integers(0, 255, 7)
    film = Film(Greys(*greys.tolist()), 30.0, loop=loop)
    shown = film.shown(start_s, start_s + length_s)
    middles = start_s + length_s * (np.arange(20_000) + 0.5) / 20_000
    numbers = np.floor(middles * 30.0).astype(int)
    numbers = numbers % 7 if loop else np.minimum(numbers, 6)
    expected = np.bincount(numbers, minlength=7) / 20_000
    found = np.zeros(7)
    for number, share in shown:
        found[number] += share
    assert found == pytest.approx(expected, abs=2e-3)


def test_the_mean_is_one_of_light():
    film = Film(Greys(0, 128), 10.0, loop=True)
    (grey,) = {*film.picture(film.shown(0.05, 0.15))[..., :3].ravel().tolist()}
    assert decode_srgb(grey / 255.0) == pytest.approx(decode_srgb(128 / 255.0) / 2, abs=0.003)


def test_only_what_is_shown_is_read():
    pictures = Greys(*range(100))
    film = Film(pictures, 10.0, loop=False)
    for time_s in (0.0, 0.0, 0.1, 0.1, 5.0, 0.1, 5.0, 6.0, 7.0, 8.0, 0.1):
        film.picture(film.shown(time_s, time_s))
    assert pictures.asked == [0, 1, 50, 60, 70, 80, 1]


def test_files_stand_in_the_order_of_their_numbers(tmp_path):
    write_pictures(tmp_path / "shots", 1, 2, 3)  # 8, 9 and 10: by letters, 10 would be the first
    world, film = film_of(tmp_path, 'frames = "shots/*.png", fps = 25, loop = false')
    assert [film.picture(film.shown(t, t))[0, 0, 0] for t in (0.0, 0.04, 0.08)] == [1, 2, 3]
    assert world.duration_s == pytest.approx(3 / 25)
    assert not world.light_repeats(0.04) and world.light_repeats(0.0)


def test_numbers_are_of_plain_digits(tmp_path):
    folder = tmp_path / "shots"
    write_pictures(folder, 5, 6)
    (folder / "shot_8.png").rename(folder / "1²2.png")
    (folder / "shot_9.png").rename(folder / "1²10.png")
    _, film = film_of(tmp_path, 'frames = "shots/*.png", fps = 1')
    assert [film.picture(film.shown(t, t))[0, 0, 0] for t in (0.0, 1.0)] == [5, 6]


def test_a_pattern_of_too_many_files_is_told_without_listing_them_all(tmp_path, monkeypatch):
    listed = []

    def names(pattern):
        for k in range(50):
            listed.append(k)
            yield f"{k}.png"

    monkeypatch.setattr("glob.iglob", names)
    monkeypatch.setattr("clsim.scene.pictures.film.MAX_PICTURES", 3)
    with pytest.raises(InputError, match=r"^more than 3 files are called '\*\.png' in .*, expected 1 to 3$"):
        Files("*.png", tmp_path, PixelBudget())
    assert listed == [0, 1, 2, 3]


def test_where_a_video_has_fewer_pictures_than_it_tells_its_last_one_stays(tmp_path):
    write_video(tmp_path / "clip.mp4", [16, 120, 240])
    video = Video(tmp_path / "clip.mp4", PixelBudget())
    video.read(0)
    assert video.read(9)[..., :3].mean() == pytest.approx(240, abs=4)
    assert video.read(8)[..., :3].mean() == pytest.approx(240, abs=4)


@pytest.mark.parametrize(("told", "fps"), [("", 50), (", fps = 12.5", 12.5)])
def test_a_video_has_its_own_rate_unless_told_and_can_go_back(tmp_path, told, fps):
    greys = [16, 60, 120, 180, 240]
    write_video(tmp_path / "clip.mp4", greys)
    _, film = film_of(tmp_path, f'file = "clip.mp4"{told}', "texture")
    assert film.fps == fps
    for k in (0, 3, 4, 1, 7):
        picture = film.picture(film.shown(k / fps, k / fps))
        assert picture.shape == (48, 64, 4)
        assert picture[..., :3].mean() == pytest.approx(greys[k % 5], abs=4)
        assert (picture[..., 3] == 255).all()


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ('frames = "none/*.png", fps = 5', "0 files are called 'none/*.png'"),
        ('frames = "shots/*.png", fps = 1e308', "emission_texture.fps: "),
        ('frames = "shots/*.png"', "has frames, expected fps with it"),
        ('file = "shots/shot_8.png", fps = 5', "belong to frames and to videos"),
        ('frames = "shots/*.png", file = "a.png", fps = 5', "expected either file or frames"),
        ("nearest = true", "expected either file or frames"),
        ('file = "bad.mp4"', "cannot be decoded"),
        ('frames = "http://a/*.png", fps = 5', "is no pattern of files"),
    ],
)
def test_what_cannot_be_a_film_is_told(tmp_path, table, said):
    write_pictures(tmp_path / "shots", 1)
    (tmp_path / "bad.mp4").write_bytes(b"no video")
    with pytest.raises(InputError) as caught:
        film_of(tmp_path, table)
    assert said in str(caught.value) and "materials.screen" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_other_textures_than_colours_are_no_films(tmp_path):
    write_pictures(tmp_path / "shots", 1)
    with pytest.raises(InputError, match=r"screen.bump_texture: is a film, expected one in texture or emission_"):
        film_of(tmp_path, 'frames = "shots/*.png", fps = 5', "bump_texture")


def test_pictures_of_another_size_are_told_when_their_time_comes(tmp_path):
    write_pictures(tmp_path / "shots", 1, 2)
    PIL.Image.new("RGB", (5, 2)).save(tmp_path / "shots" / "shot_9.png")
    _, film = film_of(tmp_path, 'frames = "shots/*.png", fps = 10')
    with pytest.raises(InputError, match=r"shot_9.png: is 5×2, expected 4×2 as the first"):
        film.picture(film.shown(0.1, 0.1))
