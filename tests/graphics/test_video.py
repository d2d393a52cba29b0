"""The video: right length and size, blocks in the right place, turned the right way, whole or not there."""

from collections.abc import Iterator
from contextlib import contextmanager

import cv2
import numpy as np
import pandas as pd
import pytest

from rock2d.errors import InputError
from rock2d.graphics import video
from rock2d.graphics.canvas import Viewport, bgr, exact_view
from rock2d.graphics.clips import Clip, clip_from_measured, clip_from_track
from rock2d.graphics.palette import SKY, zone_tones
from rock2d.graphics.scenery import ground_image
from rock2d.graphics.video_frames import Layout, VideoOptions
from rock2d.records.track import Track
from rock2d.scene.blocks import make_block
from rock2d.scene.cross_section import CrossSection

FLOOR = CrossSection([[-2, 0], [2, 0]], ["floor"])
BLOCKS = {
    "ball": make_block("ball", "circle", 0.02, "solid_sphere", diameter_m=0.1),
    "cube": make_block("cube", "square", 0.02, side_m=0.1),
}
SIZE = (480, 320)
SMALL = VideoOptions(size_px=SIZE)
VIEW = (0.0, 1.0, -0.1, 0.5)
BLUE = "#0040ff"


def clip(block: str, x_m: tuple[float, float], y_m: float, theta_rad: float = 0.0, **style: str) -> Clip:
    """Level motion from x_m[0] to x_m[1] in 0.2 s."""
    t = np.array([0.0, 0.2])
    return Clip(block, t, np.array(x_m), np.full(2, y_m), np.full(2, theta_rad), **style)


def render_video(path, ground, blocks, clips, options, progress=None):
    """A video of the clips of one scene, or of several scenes, in one panel."""
    scenes = clips if clips and not isinstance(clips[0], Clip) else [clips] if clips else []
    return video.render_video(path, ground, blocks, [[scene] for scene in scenes], ("",), options, progress)


def pictures(path) -> np.ndarray:
    film = cv2.VideoCapture(str(path))
    frames = []
    while True:
        there, frame = film.read()
        if not there:
            return np.array(frames)
        frames.append(frame)


def panel_views(options: VideoOptions, panels: int = 1) -> list[tuple[int, int, Viewport]]:
    """The left and top pixel of each panel, and its view relative to that corner."""
    layout = Layout(options.size_px, panels)
    view = exact_view(VIEW, layout.panel_width, layout.panel_height)
    return [(left, layout.top, view) for left in layout.lefts]


def like(image: np.ndarray, colour: str, within: float = 60.0) -> np.ndarray:
    """(n, 2) pixels x, y of about this colour."""
    far = np.abs(image.astype(float) - bgr(colour)).sum(axis=2)
    return np.argwhere(far < within)[:, ::-1].astype(float)


@pytest.mark.parametrize("slow_motion", [2.0, 10.0])
@pytest.mark.parametrize("suffix", [".webm", ".mp4"])
def test_video_lasts_as_long_as_the_slow_motion_says(tmp_path, slow_motion, suffix):
    path = tmp_path / f"a{suffix}"
    steps = []
    render_video(
        path, FLOOR, BLOCKS, [clip("ball", (0.2, 0.8), 0.2)],
        VideoOptions(fps_video=20, slow_motion=slow_motion, size_px=SIZE, hold_s=0.5),
        lambda done, total: steps.append((done, total)),
    )  # fmt: skip
    film = cv2.VideoCapture(str(path))
    frames = pictures(path)
    assert frames.shape[1:] == (SIZE[1], SIZE[0], 3)
    assert film.get(cv2.CAP_PROP_FPS) == pytest.approx(20)
    # both ends of the motion, then half a second
    assert len(frames) == round(0.2 * slow_motion * 20) + 1 + 10
    assert steps[-1] == (len(frames), len(frames))


def test_scenes_are_shown_one_after_another_each_on_its_own_clock(tmp_path):
    scenes = [[clip("ball", (0.2, 0.8), 0.2)], [clip("cube", (0.2, 0.8), 0.2, colour=BLUE)]]
    options = VideoOptions(slow_motion=2, size_px=SIZE, hold_s=0, view=VIEW)
    path = render_video(tmp_path / "a.webm", FLOOR, BLOCKS, scenes, options)
    frames = pictures(path)
    assert len(frames) == 22
    left, top, view = panel_views(options)[0]
    x, y = np.rint(view.pixels(np.array([0.2 + 0.04, 0.2 + 0.04]))[0]).astype(int) + np.array([left, top])
    assert len(like(frames[11][y - 2 : y + 3, x - 2 : x + 3], BLUE)) > 10  # the cube starts at the left again
    assert not len(like(frames[10][y - 2 : y + 3, x - 2 : x + 3], BLUE))


@pytest.mark.parametrize("block", ["ball", "cube"])
def test_block_is_drawn_where_it_is(tmp_path, block):
    motion = [clip(block, (0.2, 0.8), 0.25, theta_rad=0.4)]
    options = VideoOptions(slow_motion=2, size_px=SIZE, hold_s=0, view=VIEW, trail=False)
    path = render_video(tmp_path / "a.webm", FLOOR, BLOCKS, motion, options)
    frames = pictures(path).astype(int)
    empty = np.median(frames, axis=0)
    left, top, view = panel_views(options)[0]
    px_per_m = min(view.width_px / (VIEW[1] - VIEW[0]), view.height_px / (VIEW[3] - VIEW[2]))
    for k in (0, 3, 10):
        changed = np.abs(frames[k] - empty).sum(axis=2) > 90
        changed[:top] = False  # the clock
        rows, columns = np.nonzero(changed)
        # from the middle of the panel, which shows the middle of the view: (0.5, 0.2) m
        right = columns.min() + columns.max() - 2 * left - (view.width_px - 1)
        down = rows.min() + rows.max() - 2 * top - (view.height_px - 1)
        assert 0.5 * right == pytest.approx((0.2 + 0.06 * k - 0.5) * px_per_m, abs=1)
        assert -0.5 * down == pytest.approx((0.25 - 0.2) * px_per_m, abs=1)


@pytest.mark.parametrize(("block", "mark_rad"), [("ball", np.pi / 2), ("cube", -3 * np.pi / 4)])
@pytest.mark.parametrize("theta_rad", [0.0, 1.1, 2.9, -1.3])
def test_mark_turns_with_the_block_counter_clockwise(tmp_path, block, mark_rad, theta_rad):
    motion = [clip(block, (0.5, 0.5), 0.3, theta_rad, colour="#a00000")]
    options = VideoOptions(slow_motion=0.5, size_px=SIZE, hold_s=0, view=VIEW)
    path = render_video(tmp_path / "a.webm", FLOOR, BLOCKS, motion, options)
    frame = pictures(path)[0]
    left, top, view = panel_views(options)[0]
    centre = view.pixels(np.array([0.5, 0.3]))[0] + np.array([left, top])
    pale = like(frame, "#e7bfbf", 80)
    pale = pale[np.hypot(*(pale - centre).T) < 0.04 * view.px_per_m]
    assert len(pale) > 20
    dx, dy = (pale - centre).mean(axis=0)
    off = (np.arctan2(-dy, dx) - theta_rad - mark_rad + np.pi) % (2 * np.pi) - np.pi
    assert abs(off) < np.deg2rad(12)


def test_side_by_side_shows_both_and_the_measured_ghost(tmp_path):
    measured = clip("cube", (0.3, 0.3), 0.3, colour="#202020")
    simulated = clip("cube", (0.7, 0.7), 0.3, colour=BLUE)
    options = VideoOptions(slow_motion=0.5, size_px=(640, 320), view=VIEW, hold_s=0)
    scene, labels = [[measured], [simulated]], ("measured", "simulated")
    path = video.render_video(tmp_path / "a.webm", FLOOR, BLOCKS, [scene], labels, options)
    frame = pictures(path)[0]
    panels = panel_views(options, panels=2)

    def seen(panel: int, x_m: float) -> np.ndarray:
        left, top, view = panels[panel]
        x, y = np.rint(view.pixels(np.array([x_m + 0.025, 0.325]))[0]).astype(int) + np.array([left, top])
        return frame[y - 1 : y + 2, x - 1 : x + 2].reshape(-1, 3).mean(axis=0)

    assert np.abs(seen(0, 0.3) - bgr("#202020")).max() < 25
    assert np.abs(seen(0, 0.7) - bgr(SKY)).max() < 12  # nothing simulated on the left
    assert np.abs(seen(1, 0.7) - bgr(BLUE)).max() < 40
    ghost = seen(1, 0.3)
    assert (ghost < np.array(bgr(SKY)) - 30).all()  # there, but faint
    assert (ghost > 120).all()


@contextmanager
def short_files(most_bytes: int) -> Iterator[None]:
    """As on a disk that is nearly full: no file grows beyond `most_bytes`."""
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most_bytes, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("suffix", [".webm", ".mp4"])
@pytest.mark.parametrize("share", [0.1, 0.9])
def test_a_video_that_finds_no_room_is_not_there(tmp_path, suffix, share):
    cubes = [clip("cube", (0.2, 0.8), 0.2)]
    whole = render_video(tmp_path / f"whole{suffix}", FLOOR, BLOCKS, cubes, SMALL)
    with short_files(int(share * whole.stat().st_size)), pytest.raises(OSError, match=f"cut{suffix}"):
        render_video(tmp_path / f"cut{suffix}", FLOOR, BLOCKS, cubes, SMALL)
    assert [path.name for path in tmp_path.iterdir()] == [whole.name]


def test_what_cannot_be_shown_is_named(tmp_path):
    ball = clip("ball", (0.2, 0.8), 0.2)
    with pytest.raises(InputError, match=r"\.webm or \.mp4.*\.gif"):
        render_video(tmp_path / "a.gif", FLOOR, BLOCKS, [ball], SMALL)
    with pytest.raises(InputError, match="nothing to show"):
        render_video(tmp_path / "a.webm", FLOOR, BLOCKS, [], SMALL)
    with pytest.raises(InputError, match=r"block egg.*ball, cube"):
        render_video(tmp_path / "a.webm", FLOOR, BLOCKS, [clip("egg", (0, 1), 0.2)], SMALL)
    with pytest.raises(ValueError, match="even"):
        render_video(tmp_path / "a.webm", FLOOR, BLOCKS, [ball], VideoOptions(size_px=(481, 320)))
    assert not list(tmp_path.iterdir())


def test_short_gaps_are_bridged_and_long_ones_hide_the_block():
    t = np.delete(np.arange(40) * 1e-3, [10, 11, *range(20, 35)])
    rows = pd.DataFrame({"release": 3, "block": "ball", "t_s": t, "x_m": 2 * t, "y_m": 0.2, "theta_rad": 5 * t})
    rows.loc[4, "x_m"] = np.nan  # an empty cell is a lost frame too
    shown = clip_from_measured(rows)
    for time_s in (0.004, 0.0105):
        assert shown.pose(time_s) == pytest.approx((2 * time_s, 0.2, 5 * time_s))
    assert shown.pose(0.027) is None
    assert shown.pose(-0.001) is None
    assert shown.pose(0.037) is not None
    ways = shown.path(-np.inf, np.inf)
    assert [w[0, 0] for w in ways] == pytest.approx([0.0, 2 * 0.035])
    assert ways[0][-1, 0] == pytest.approx(2 * 0.019)


def test_orientation_recorded_modulo_a_turn_does_not_spin_back():
    t = np.arange(20) * 1e-2
    theta = (9 * t + np.pi) % (2 * np.pi) - np.pi
    rows = pd.DataFrame({"block": "ball", "t_s": t, "x_m": t, "y_m": t, "theta_rad": theta})
    shown = clip_from_measured(rows)
    assert np.diff(shown.theta_rad) == pytest.approx(np.full(19, 0.09))


def test_clip_of_a_track_follows_the_parabola_and_stays_where_it_stopped():
    knots = np.array([[0, 0, 1, 0, 2, 0, 3], [0.4, 0.8, 1 - 0.5 * 9.81 * 0.16, 1.2, 2, -9.81 * 0.4, 3]], float)
    shown = clip_from_track(Track(0, "ball", knots, np.array([True, True]), [], "exit", 9.81))
    t = 0.23456
    assert shown.pose(t) == pytest.approx((2 * t, 1 - 0.5 * 9.81 * t**2, 3 * t), abs=2e-6)
    assert shown.pose(1.0) == pytest.approx(tuple(knots[1, 1:4]))


def test_ground_under_an_overhang_is_air_and_a_vertical_facing_has_its_own_tone():
    cross_section = CrossSection(
        [[0, 0], [1, 0], [1, 1], [0.6, 1.2], [2, 1.2]], ["floor", "wall", "roof", "top"]
    )  # the roof leans out over the floor
    view = Viewport(0.0, 2.0, 100.0, 200, 220)
    image = ground_image(cross_section, view, 20)

    def tone(x_m: float, y_m: float) -> list[int]:
        x, y = np.rint(view.pixels(np.array([x_m, y_m]))[0]).astype(int)
        return image[y, x].tolist()

    assert tone(0.8, 0.9) == list(bgr(SKY))
    tones = {zone: list(bgr(colour)) for zone, colour in zone_tones(cross_section.zone_names).items()}
    assert np.abs(np.subtract(tone(1.05, 0.5), tones["wall"])).max() <= 2
    assert np.abs(np.subtract(tone(0.5, -0.05), tones["floor"])).max() <= 2
    assert np.abs(np.subtract(tone(1.5, 1.15), tones["top"])).max() <= 2
