"""Films are read as they were recorded: brightness, colour, length, and instants."""

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from rock2d_tracking import film_reading
from rock2d_tracking.film_reading import FilmFile

from rock2d.errors import InputError
from tests.tracking.user_films import hide_first_frames

HEIGHT, WIDTH = 96, 128
GREYS = np.tile(np.linspace(0, 250, WIDTH).astype(np.uint8), (HEIGHT, 1))


def written(
    path: Path, pictures: Sequence[np.ndarray], ticks_ms: Sequence[int], *, full: bool = False,
    aspect: Fraction | None = None,
) -> Path:  # fmt: skip
    """A film of H.264 without loss, a picture at each of these instants. `aspect`: of its pixels, if it states one."""
    with av.open(str(path), "w") as film:
        stream = film.add_stream("libx264", rate=30, options={"qp": "0", "preset": "ultrafast"})
        stream.height, stream.width, stream.pix_fmt = HEIGHT, WIDTH, "yuvj420p" if full else "yuv420p"
        stream.codec_context.time_base = Fraction(1, 1000)
        if aspect is not None:
            stream.codec_context.sample_aspect_ratio = aspect
        for picture, tick in zip(pictures, ticks_ms, strict=True):
            frame = av.VideoFrame.from_ndarray(picture, format="bgr24")
            if full:
                frame = frame.reformat(format="yuvj420p")
            frame.pts, frame.time_base = tick, Fraction(1, 1000)
            film.mux(stream.encode(frame))
        film.mux(stream.encode(None))
    return path


def grey(count: int) -> list[np.ndarray]:
    return [np.repeat(np.roll(GREYS, k, axis=1)[..., None], 3, axis=2) for k in range(count)]


@pytest.mark.parametrize("full", [False, True])
def test_a_grey_film_has_one_value_a_pixel_in_the_whole_range(tmp_path, full):
    path = written(tmp_path / "a.mp4", grey(5), range(0, 165, 33), full=full)
    frames = list(FilmFile(path).frames())
    assert len(frames) == 5
    for seen, drawn in zip(frames, grey(5), strict=True):
        assert seen.shape == (HEIGHT, WIDTH)
        assert np.abs(seen.astype(int) - drawn[..., 0]).max() <= 2


def test_a_coloured_film_keeps_its_colours(tmp_path):
    red = np.full((HEIGHT, WIDTH, 3), (30, 40, 200), np.uint8)
    frames = list(FilmFile(written(tmp_path / "a.mp4", [red] * 3, [0, 33, 66])).frames())
    assert np.abs(frames[0].astype(int) - red).max() <= 4


def test_frames_that_follow_one_another_need_no_remark(tmp_path):
    film = FilmFile(written(tmp_path / "a.mp4", grey(12), [round(k * 1000 / 30) for k in range(12)]))
    frames = film.frames()
    assert sum(1 for _ in frames) == 12 == film.expected_frames
    assert frames.stamps(30.0).remark == ""
    np.testing.assert_array_equal(frames.stamps(30.0).numbers, np.arange(12))


def test_frames_that_are_missing_by_their_time_stamps_keep_their_numbers(tmp_path):
    filmed = [0, 1, 2, 3, 5, 6, 7, 10, 11, 12, 13]
    frames = FilmFile(written(tmp_path / "a.mp4", grey(len(filmed)), [round(k * 1000 / 30) for k in filmed])).frames()
    list(frames)
    np.testing.assert_array_equal(frames.stamps(30.0).numbers, filmed)
    assert "3 frames missing" in frames.stamps(30.0).remark


def test_a_frame_rate_that_varies_is_said(tmp_path):
    ticks = np.cumsum([0, 33, 33, 50, 33, 33, 33, 58, 33, 33])
    frames = FilmFile(written(tmp_path / "a.mp4", grey(10), ticks.tolist())).frames()
    list(frames)
    played, slow = frames.stamps(28.0), frames.stamps(240.0)
    assert "varies" in played.remark and "33" in played.remark and "58" in played.remark
    np.testing.assert_array_equal(played.numbers, np.arange(10))
    np.testing.assert_allclose(played.clock(np.arange(10)), 28.0 * ticks / 1000)  # seconds are seconds
    assert "drawn out from 30.3 to 240 frames/s" in slow.remark
    np.testing.assert_allclose(slow.clock(np.arange(10)), ticks / 33)
    assert slow.clock(0.5) == pytest.approx(0.5)
    assert slow.clock(-2) == pytest.approx(-2) and slow.clock(10) == pytest.approx(ticks[-1] / 33 + 1)


def test_a_phone_that_is_mostly_slower_than_its_stated_rate_keeps_its_seconds(tmp_path):
    ticks = np.cumsum([0, *[33] * 4, *[48, 51, 50] * 4])
    frames = FilmFile(written(tmp_path / "a.mp4", grey(17), ticks.tolist())).frames()
    list(frames)
    np.testing.assert_allclose(frames.stamps(30.0).clock(np.arange(17)), 30.0 * ticks / 1000)


def test_stamps_that_no_camera_makes_are_left_aside(tmp_path):
    ticks = np.cumsum([0, *[33] * 6, *[8] * 3]).tolist()  # slow motion, and a part at full pace
    frames = FilmFile(written(tmp_path / "a.mp4", grey(10), ticks)).frames()
    list(frames)
    stamps = frames.stamps(240.0)
    assert "no camera does that" in stamps.remark
    np.testing.assert_array_equal(stamps.clock(np.arange(10)), np.arange(10))


@pytest.mark.parametrize("shown", [20, 40])
def test_a_film_that_a_phone_trimmed_shows_what_is_played(tmp_path, shown):
    path = written(tmp_path / "a.mp4", grey(40), range(0, 1600, 40))
    hide_first_frames(path, 10, shown, 25.0)  # the edit may be stated longer than the film is
    film = FilmFile(path)
    frames = list(film.frames())
    assert len(frames) == min(shown, 30)
    assert np.abs(frames[0].astype(int) - grey(40)[10][..., 0]).max() <= 2
    assert film.frames().stamps(30.0).remark == ""


def test_frames_that_are_decoded_out_of_order_are_evenly_spaced(tmp_path):
    path = tmp_path / "a.avi"
    with av.open(str(path), "w") as film:
        stream = film.add_stream("libx264", rate=30, options={"bf": "2"})
        stream.height, stream.width, stream.pix_fmt = HEIGHT, WIDTH, "yuv420p"
        for number in range(30):
            picture = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
            picture[:, 2 * number : 2 * number + 20] = 200
            frame = av.VideoFrame.from_ndarray(picture, format="bgr24")
            frame.pts = number
            film.mux(stream.encode(frame))
        film.mux(stream.encode(None))
    frames = FilmFile(path).frames()
    list(frames)
    assert np.diff(frames.times_s).min() < 0.0  # the container keeps no instants at which frames are shown
    assert frames.stamps(30.0).remark == ""
    np.testing.assert_array_equal(frames.stamps(30.0).numbers, np.arange(30))


def test_a_film_that_ends_early_is_refused(tmp_path):
    whole = written(tmp_path / "a.mkv", grey(60), range(0, 1980, 33)).read_bytes()
    (tmp_path / "half.mkv").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match="ends early"):
        list(FilmFile(tmp_path / "half.mkv").frames())


def test_a_film_of_an_upright_phone_is_turned(tmp_path):
    corner = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    corner[:32, :48] = 250
    path = written(tmp_path / "a.mp4", [corner] * 3, [0, 33, 66])
    one, no = (1 << 16).to_bytes(4, "big"), bytes(4)
    upright = one + no * 3 + one
    turned = no + one + no + (-(1 << 16)).to_bytes(4, "big", signed=True) + no  # clockwise by a quarter
    stored = path.read_bytes()
    at = stored.index(upright, stored.index(b"tkhd"))
    path.write_bytes(stored[:at] + turned + stored[at + len(turned) :])
    film = FilmFile(path)
    assert film.size_px == (HEIGHT, WIDTH)
    [first, *_] = film.frames()
    assert first.shape == (WIDTH, HEIGHT)
    assert first[10, HEIGHT - 10] > 240  # from the left to the right upper corner
    assert first[10, 10] < 10 and first[WIDTH - 10, 10] < 10


@pytest.mark.parametrize("aspect", [Fraction(4, 3), Fraction(8, 9)])
def test_pixels_that_are_not_square_are_refused(tmp_path, aspect):
    path = written(tmp_path / "a.mp4", grey(3), [0, 33, 66], aspect=aspect)
    with pytest.raises(InputError, match=f"{float(aspect):.4g} times as wide as high; .*setsar=1") as caught:
        FilmFile(path)
    assert caught.value.file == path


@pytest.mark.parametrize("aspect", [Fraction(1, 1), Fraction(192, 191)])
def test_a_size_that_a_program_rounded_leaves_pixels_square(tmp_path, aspect):
    assert FilmFile(written(tmp_path / "a.mp4", grey(3), [0, 33, 66], aspect=aspect)).size_px == (WIDTH, HEIGHT)


@pytest.mark.parametrize(("in_memory", "of_disk", "readings"), [(99, 0.5, 1), (4, 0.5, 1), (4, 0.0, 3)])
def test_frames_are_kept_in_memory_and_on_disk_and_are_the_same_each_time(
    tmp_path, monkeypatch, in_memory, of_disk, readings
):
    film = FilmFile(written(tmp_path / "a.mp4", grey(10), range(0, 330, 33)))
    monkeypatch.setattr(film_reading, "KEPT_BYTES", in_memory * HEIGHT * WIDTH)
    monkeypatch.setattr(film_reading, "MOST_OF_DISK", of_disk)
    expected, frames, opened = list(film.frames()), film.frames(), []
    monkeypatch.setattr(film, "_open", lambda own=film._open: opened.append(1) or own())
    for _ in range(3):
        seen = list(frames)
        assert len(seen) == 10 and all((a == b).all() for a, b in zip(seen, expected, strict=True))
    assert len(opened) == readings
