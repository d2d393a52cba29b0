"""Pixels and metres: there and back, with every convention said aloud."""

import os
import warnings

import numpy as np
import pandas as pd
import pytest
from rock2d_tracking.camera import PixelMap
from rock2d_tracking.setup_file import Setup, write_setup

from rock2d.errors import InputError, UnusualWarning
from rock2d.files.experiment import Experiment
from tests.programs import refusal
from tests.tracking.falls import BLOCKS, CROSS_SECTION

SETUP = """\
name: set-up
gravity_m_s2: 9.81
camera:
  fps: 1000.0
  scale: {scale}
  up: up
  origin_px: [100.0, 300.0]
cross_section:
  points_m: [[-0.2, 0.0], [0.5, 0.0]]
  zones: [floor]
blocks:
  cube: {{shape: square, side_m: 0.02, mass_kg: 0.02}}
releases: [cube]
"""


BOARD = "{checkerboard: board.png, columns: 10, rows: 7, square_m: 0.012}"


def setup(tmp_path, scale: str, **changes: str) -> Setup:
    text = SETUP.format(scale=scale)
    for old, new in changes.items():
        text = text.replace(old, new)
    (tmp_path / "setup.yaml").write_text(text)
    return Setup(tmp_path / "setup.yaml")


def checkerboard() -> np.ndarray:
    """Seven by ten inner corners, 24 px apart, within a white margin."""
    squares = (np.indices((8, 11)).sum(axis=0) % 2 * 255).astype(np.uint8)
    return np.pad(np.kron(squares, np.ones((24, 24), np.uint8)), 40, constant_values=255)


@pytest.mark.parametrize("up", [-1, 1])
@pytest.mark.parametrize("k", [0.0, -0.148, -0.08, 0.05, 0.5])
def test_there_and_back(up, k):
    camera = PixelMap(6e-4, (640.0, 700.0), (0.1, 0.05), up, 0.03, k, (640.0, 400.0), 755.0)
    points = np.random.default_rng(0).uniform([-0.3, -0.1], [0.3, 0.3], (50, 2))
    np.testing.assert_allclose(camera.to_world(camera.to_pixel(points)), points, atol=1e-9)
    assert camera.angle_to_world(camera.angle_to_pixel(np.array(0.4))) == pytest.approx(0.4)


def test_a_lens_that_folds_the_picture_over_is_refused(tmp_path):
    """Seen ρ (1 + k ρ²) has its maximum at ρ² = -1 / 3k; the corner lies beyond it with k below -4/27."""
    lens = "{k: -0.148}", "{k: -0.117, centre_px: [640, 200]}", "{k: -0.119, centre_px: [640, 200]}", "{k: -0.149}"
    for distortion, at_least in zip(lens, (None, None, "at least -0.117", "-0.148"), strict=True):
        camera = {"  up: up": f"  up: up\n  distortion: {distortion}"}
        if at_least is None:
            assert setup(tmp_path, "{metres_per_pixel: 5.0e-4}", **camera).for_images((1280, 720)).keys
        else:
            with pytest.raises(InputError, match=rf"setup.yaml:7.*{at_least}"):
                setup(tmp_path, "{metres_per_pixel: 5.0e-4}", **camera).for_images((1280, 720))


@pytest.mark.parametrize(
    ("origin", "points", "said"),
    [
        ("[100.0, 300.0]", "[[40, 360], [1240, 360]]", ""),
        ("[640.0, 1200.0]", "[[40, 360], [1240, 360]]", r"setup.yaml:\d+:\d+: camera.origin_px: lies 84. px"),
        ("[100.0, 300.0]", "[[40, 360], [1640, 360]]", r"setup.yaml:\d+:\d+: camera.scale.points_px.1.?: lies 100. px"),
    ],
)
def test_a_point_beyond_the_fold_of_a_lens_is_refused(tmp_path, origin, points, said):
    """Seen ρ ends at 2 / (3 √(-3k)), at 734 px here: farther out, no place in the world looks so."""
    lens = {"  up: up": "  up: up\n  distortion: {k: -0.148}", "[100.0, 300.0]": origin}
    found = setup(tmp_path, f"{{points_px: {points}, distance_m: 2.0}}", **lens)
    if said:
        refusal(found.for_images, (1280, 720), said=said)
    else:
        assert found.pixel_map((1280, 720)).farthest_px == pytest.approx(734, abs=1)


def test_what_rises_in_the_world_falls_in_the_rows_of_the_image():
    camera = PixelMap(1e-3, (10.0, 20.0))
    np.testing.assert_allclose(camera.to_pixel(np.array([0.002, 0.003])), [12.0, 17.0])
    assert camera.angle_to_pixel(np.array(0.3)) == pytest.approx(-0.3)


def test_angles_turn_as_directions_do():
    camera = PixelMap(1e-3, (0.0, 0.0), tilt_rad=0.1)
    ahead = camera.to_pixel(np.array([np.cos(0.3), np.sin(0.3)])) - camera.to_pixel(np.zeros(2))
    assert np.arctan2(ahead[1], ahead[0]) == pytest.approx(float(camera.angle_to_pixel(np.array(0.3))))


def test_scale_from_a_known_length_and_from_a_checkerboard(tmp_path):
    import cv2

    assert setup(tmp_path, "{points_px: [[0, 0], [300, 400]], distance_m: 0.25}").metres_per_pixel == 5e-4
    board = checkerboard()
    cv2.imwrite(str(tmp_path / "board.png"), board)
    found = setup(tmp_path, BOARD)
    assert found.metres_per_pixel == pytest.approx(0.012 / 24, rel=1e-3)


def test_a_checkerboard_in_a_picture_of_another_size_than_the_film_is_refused(tmp_path):
    """Its squares have another number of pixels there."""
    import cv2

    board = checkerboard()
    height, width = board.shape
    cv2.imwrite(str(tmp_path / "board.png"), board)
    found = setup(tmp_path, BOARD)
    assert found.for_images((width, height)).metres_per_pixel == found.metres_per_pixel
    said = rf"camera.scale.checkerboard: the film has {2 * width} x {2 * height} px, .* {width} x {height} px"
    error = refusal(found.for_images, (2 * width, 2 * height), said=said)
    assert error.file == tmp_path / "setup.yaml" and error.line == 5


@pytest.mark.parametrize("tilt_deg", [-7.0, 20.0])
@pytest.mark.parametrize("up", ["up", "down"])
def test_what_falls_in_a_tilted_film_falls_straight_down(tmp_path, up, tilt_deg):
    """A level line rises by the tilt in the picture, whether the world's y grows to its top or to its bottom."""
    rise = np.deg2rad(tilt_deg)
    level = np.array([np.cos(rise), -np.sin(rise)])  # [u, v], v downward
    upright = np.array([-np.sin(rise), -np.cos(rise)]) if up == "up" else np.array([np.sin(rise), np.cos(rise)])
    t_s = np.linspace(0, 0.2, 9)[:, None]
    seen = np.array([400.0, 300.0]) + (1.5 * t_s * level - 0.5 * 9.81 * t_s**2 * upright) / 5e-4
    found = setup(tmp_path, "{metres_per_pixel: 5.0e-4}", **{"  up: up": f"  up: {up}\n  tilt_deg: {tilt_deg}"})
    assert found.g_px_frame2 == pytest.approx(found.down * found.scale.g_px_frame2 * np.cos(rise))  # the part along v
    camera = found.pixel_map((1280, 720))
    way = camera.to_world(seen) - camera.to_world(seen[:1])
    np.testing.assert_allclose(way, np.hstack([1.5 * t_s, -0.5 * 9.81 * t_s**2]), atol=1e-12)
    assert camera.angle_to_world(np.arctan2(level[1], level[0])) == pytest.approx(0.0)


@pytest.mark.parametrize("up", [-1, 1])
def test_a_written_set_up_file_has_the_tilt_of_its_camera(tmp_path, up):
    camera = PixelMap(6e-4, (100.0, 320.0), up=up, tilt_rad=0.1)
    stated = Experiment("film", 9.81, 1000.0, 0.0, 0.0, CROSS_SECTION, BLOCKS, impacts=pd.DataFrame())
    write_setup(tmp_path / "setup.yaml", stated, camera, ["cube"])
    assert Setup(tmp_path / "setup.yaml").pixel_map(None).tilt_rad == pytest.approx(0.1)


@pytest.mark.parametrize("distortion", ["{k: -0.1}", "{k: 0.08}", "{k: -0.1, centre_px: [600, 380]}", "{k: 0.0}"])
def test_marked_points_are_as_far_apart_as_stated_whatever_the_lens(tmp_path, distortion):
    scale = "{points_px: [[40, 360], [1240, 360]], distance_m: 2.0}"
    found = setup(tmp_path, scale, **{"  up: up": f"  up: up\n  tilt_deg: 2.0\n  distortion: {distortion}"})
    a, b = found.pixel_map((1280, 720)).to_world(np.array([[40, 360], [1240, 360]]))
    assert np.hypot(*(b - a)) == pytest.approx(2.0, rel=1e-9)
    sized = found.for_images((1280, 720))
    assert sized.metres_per_pixel == found.pixel_map((1280, 720)).metres_per_pixel
    assert sized.fps == 1000.0


@pytest.mark.parametrize("centre", [None, (200.0, 120.0)])
def test_squares_of_a_bent_checkerboard_are_as_large_as_stated(tmp_path, centre):
    import cv2

    board = checkerboard()
    height, width = board.shape
    middle = ((width - 1) / 2, (height - 1) / 2)
    lens = PixelMap(1.0, (0.0, 0.0), up=1, k=-0.1, centre_px=centre or middle, half_px=float(np.hypot(*middle)))
    seen = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(float)
    flat = lens._undistorted(seen).astype(np.float32)
    cv2.imwrite(
        str(tmp_path / "board.png"), cv2.remap(board, flat[..., 0], flat[..., 1], cv2.INTER_LINEAR, borderValue=255)
    )
    bent = "{k: -0.1}" if centre is None else f"{{k: -0.1, centre_px: [{centre[0]}, {centre[1]}]}}"
    found = setup(tmp_path, BOARD, **{"  up: up": f"  up: up\n  distortion: {bent}"})
    assert found.metres_per_pixel == pytest.approx(0.012 / 24, rel=1e-3)


@pytest.mark.parametrize(
    "narrow",
    [((0, 0), (0, 40), (0, -40), (0, 0)), ((6, 0), (-6, 0), (0, 0), (0, 0)), ((0, 0), (0, 0), (-6, 0), (6, 0))],
    ids=["right", "top", "bottom"],
)
def test_a_checkerboard_seen_at_a_slant_is_refused(tmp_path, narrow):
    """One side is farther away. Its corners move inward by some pixels."""
    import cv2

    board = checkerboard()
    height, width = board.shape
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
    slant = cv2.getPerspectiveTransform(corners, corners + np.array(narrow, np.float32))
    cv2.imwrite(str(tmp_path / "board.png"), cv2.warpPerspective(board, slant, (width, height), borderValue=255))
    with pytest.raises(InputError, match="slant"):
        setup(tmp_path, BOARD)


@pytest.mark.parametrize(
    ("scale", "changes", "said"),
    [
        ("{metres_per_pixel: 1.0e-3, distance_m: 0.3}", {}, "exactly one of"),
        ("{points_px: [[1, 2], [1, 2]], distance_m: 0.3}", {}, "the same"),
        ("{metres_per_pixel: 1.0e-3}", {"fps: 1000.0": "speed: 1000.0"}, "speed"),
        ("{metres_per_pixel: 1.0e-3}", {"  up: up\n": ""}, "up"),
        ("{metres_per_pixel: gravity}", {"fps: 1000.0": "fps: gravity"}, "not both"),
        ("{metres_per_pixel: 1.0e-3}", {"fps: 1000.0": "fps: soon"}, "expected a number or gravity"),
        ("{metres_per_pixel: 1.0e-3}", {"fps: 1000.0": "fps: -3"}, "greater than 0|> 0"),
        ("{checkerboard: ../board.png, square_m: 0.1}", {}, "camera.scale.checkerboard: .* found '..'"),
        ("{metres_per_pixel: 1.0e-3}", {"releases: [cube]": "releases: [cub]"}, "did you mean 'cube'"),
        ("{metres_per_pixel: 1.0e-3}", {"[cube]": "[cube]\ndetection: {background_frames: [-1, 9]}"}, "equal to 0"),
        ("{metres_per_pixel: 1.0e-3}", {"[cube]": "[cube]\ndetection: {background_frames: [9, 2]}"}, "found 9, 2"),
    ],
)
def test_mistakes_are_told_with_their_place(tmp_path, scale, changes, said):
    error = refusal(setup, tmp_path, scale, said=said, **changes)
    assert "setup.yaml:" in str(error) and error.line


def test_a_mass_in_g_is_told(tmp_path):
    with pytest.warns(UnusualWarning, match=r"setup.yaml:12:3: blocks.cube: .* Is the mass in g instead of kg"):
        setup(tmp_path, "{metres_per_pixel: 1.0e-3}", **{"mass_kg: 0.02": "mass_kg: 20"})


def test_a_gravity_that_the_film_cannot_check_is_told_if_it_is_unusual(tmp_path):
    with pytest.warns(UnusualWarning, match=r"setup.yaml:2:1: gravity_m_s2: gravity is 9.18 m/s²; on the earth"):
        setup(tmp_path, "{metres_per_pixel: gravity}", **{"9.81": "9.18"})
    with warnings.catch_warnings(action="error"):
        setup(tmp_path, "{metres_per_pixel: gravity}")
        setup(tmp_path, "{metres_per_pixel: 1.0e-3}", **{"9.81": "9.18"})  # what falls shows it


def test_a_written_set_up_file_can_be_read_where_it_stands(tmp_path):
    import cv2

    (tmp_path / "pictures").mkdir()
    cv2.imwrite(str(tmp_path / "pictures" / "board.png"), checkerboard())
    found = setup(tmp_path, BOARD.replace("board.png", "pictures/board.png"))
    (tmp_path / "pictures" / "board.png").unlink()  # what was read is written, though it is gone
    (tmp_path / "out").mkdir()
    found.write(tmp_path / "out")
    again = Setup(tmp_path / "out" / "setup.yaml")
    assert again.text == found.text and again.metres_per_pixel == found.metres_per_pixel


@pytest.mark.parametrize("content", [b"", b"no picture"])
def test_a_checkerboard_that_is_no_picture_is_refused(tmp_path, content):
    (tmp_path / "board.png").write_bytes(content)
    assert refusal(setup, tmp_path, BOARD, said="cannot be read as a picture").file == tmp_path / "board.png"


def test_a_checkerboard_that_is_a_pipe_is_refused(tmp_path):
    os.mkfifo(tmp_path / "board.png")
    with pytest.raises(InputError, match="expected a file, found a pipe"):
        setup(tmp_path, BOARD)
