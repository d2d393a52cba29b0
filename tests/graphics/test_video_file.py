"""A video file: every picture at its time and in its colours, the same bytes every time, whole or not there."""

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from rock2d.errors import InputError
from rock2d.graphics.video_file import ENCODERS, Encoder, write_video

SIZE = (320, 240)
COLOURS = [(200, 60, 30), (40, 160, 60), (30, 60, 200), (250, 250, 250), (10, 10, 10)]


def flat(count: int) -> list[np.ndarray]:
    """Pictures of one colour each."""
    return [np.full((SIZE[1], SIZE[0], 3), COLOURS[k % len(COLOURS)], np.uint8) for k in range(count)]


def decoded(path: Path) -> list[tuple[float, np.ndarray]]:
    """Instant in s and BGR picture of each frame."""
    with av.open(str(path)) as film:
        return [(frame.time, frame.to_ndarray(format="bgr24")) for frame in film.decode(video=0)]


@pytest.mark.parametrize("suffix", [".webm", ".mp4"])
@pytest.mark.parametrize("fps", [25.0, 60.0, float(Fraction(30000, 1001))])
def test_each_picture_is_there_at_its_time(tmp_path, suffix, fps):
    path = write_video(tmp_path / f"a{suffix}", flat(23), 23, fps, SIZE)
    times = [t for t, _ in decoded(path)]
    # WebM counts in milliseconds
    np.testing.assert_allclose(times, np.arange(23) / fps, atol=0.6e-3)


@pytest.mark.parametrize("suffix", [".webm", ".mp4"])
def test_colours_are_those_that_were_drawn(tmp_path, suffix):
    path = write_video(tmp_path / f"a{suffix}", flat(5), 5, 25, SIZE)
    for (_, seen), drawn in zip(decoded(path), flat(5), strict=True):
        assert np.abs(seen[20:-20, 20:-20].astype(int) - drawn[20:-20, 20:-20]).max() <= 6


def test_webm_is_vp9_in_a_format_that_browsers_play(tmp_path):
    path = write_video(tmp_path / "a.webm", flat(3), 3, 25, SIZE)
    with av.open(str(path)) as film:
        assert film.streams.video[0].codec_context.name in ("vp9", "libvpx-vp9")
        assert film.streams.video[0].codec_context.pix_fmt == "yuv420p"


def test_pictures_may_be_drawn_over(tmp_path):
    def one_canvas() -> Iterator[np.ndarray]:
        canvas = np.empty((SIZE[1], SIZE[0], 3), np.uint8)
        for picture in flat(20):
            canvas[:] = picture
            yield canvas

    over = write_video(tmp_path / "over.webm", one_canvas(), 20, 25, SIZE)
    own = write_video(tmp_path / "own.webm", flat(20), 20, 25, SIZE)
    assert over.read_bytes() == own.read_bytes()


def test_a_drawing_that_fails_leaves_the_film_of_yesterday_and_nothing_else(tmp_path):
    (tmp_path / "a.webm").write_bytes(b"old")

    def broken() -> Iterator[np.ndarray]:
        yield from flat(4)
        raise RuntimeError("no more ink")

    with pytest.raises(RuntimeError, match="no more ink"):
        write_video(tmp_path / "a.webm", broken(), 9, 25, SIZE)
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"old"]


def test_a_picture_of_another_size_leaves_nothing(tmp_path):
    other = [*flat(8), np.zeros((SIZE[1], SIZE[0] + 2, 3), np.uint8)]
    with pytest.raises(ValueError, match="shape"):
        write_video(tmp_path / "a.webm", other, 9, 25, SIZE)
    assert not list(tmp_path.iterdir())


def test_an_encoder_that_fails_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.setitem(ENCODERS, ".webm", Encoder("libvpx-vp9", {"cpu-used": "99"}))  # it refuses this
    with pytest.raises(InputError, match=r"a\.webm: cannot be written"):
        write_video(tmp_path / "a.webm", flat(9), 9, 25, SIZE)
    assert not list(tmp_path.iterdir())
