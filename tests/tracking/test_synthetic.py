"""The synthetic film: the picture shows what the truth says, each fault does what it is called, nothing else."""

import itertools
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pandas as pd
import pytest
import shapely
from rock2d_tracking.camera import PixelMap
from rock2d_tracking.synthetic.faults import MODERATE, SEVERE, Faults, vertical_jumps
from rock2d_tracking.synthetic.film import TRUTH_COLUMNS, FilmOptions, Shot, film_frames, write_film
from rock2d_tracking.synthetic.scene import Look, coverage

from rock2d.errors import InputError
from rock2d.files.experiment import Experiment
from rock2d.scene.blocks import Block, make_block
from rock2d.scene.cross_section import CrossSection
from tests.graphics.test_video import short_files

cv2.setNumThreads(1)

SIZE = (160, 120)
MM = 1.0e-3
MAP = PixelMap(0.5 * MM, (80.0, 60.0))
BLOCKS = {
    "ball": make_block("ball", "circle", 0.02, diameter_m=25 * MM),
    "cube": make_block("cube", "square", 0.02, side_m=19 * MM),
    "slab": make_block("slab", "rectangle", 0.02, length_m=35 * MM, height_m=14 * MM),
    "egg": make_block("egg", "ellipse", 0.02, length_m=30 * MM, height_m=20 * MM),
    "stone": make_block("stone", "polygon", 0.02, vertices_m=np.array([[0, 0], [20, -4], [30, 10], [12, 20]]) * MM),
}
FLOOR = CrossSection([[-1, -10 * MM], [1, -10 * MM]], ["floor"])
ABYSS = CrossSection([[-1, -1], [1, -1]], ["floor"])  # out of the picture
EVEN = Look(gradient_grey=0.0, texture_grey=0.0, rough_px=0.0, marked=())
POSES = [(0.0, 0.0, 0.0), (0.13 * MM, -0.21 * MM, 0.4), (-0.35 * MM, 0.05 * MM, 1.3), (0.42 * MM, 0.42 * MM, -2.5)]


def trajectories(table: pd.DataFrame, cross_section: CrossSection, blocks: dict[str, Block]) -> Experiment:
    return Experiment("setup", 9.81, 1000.0, 0.0, 0.0, cross_section, blocks, trajectories=table)


def filmed(block: str, poses: Any, cross_section: CrossSection = ABYSS, blocks: Any = BLOCKS, **how: Any) -> list[Shot]:
    """Shots of one release, a pose a frame, without rest frames."""
    table = pd.DataFrame(np.array(poses, float), columns=["x_m", "y_m", "theta_rad"])
    table = table.assign(release=0, block=block, t_s=np.arange(len(table)) / 1000.0)
    pixel_map, size_px = how.pop("pixel_map", MAP), how.pop("size_px", SIZE)
    options = FilmOptions(**{"look": EVEN, "seed": 1, "rest_frames": 0} | how)
    return list(film_frames(trajectories(table, cross_section, blocks), pixel_map, size_px, options))


def two_releases() -> Experiment:
    """A falling ball, then a falling slab; the ball's fourth row is missing, its sixth has no position."""
    t = np.arange(40) / 1000.0
    fall = pd.DataFrame({"t_s": t, "x_m": 0.5 * t - 0.01, "y_m": 0.01 - 0.4 * t, "theta_rad": 20 * t})
    ball, slab = fall.assign(release=3, block="ball").drop(3), fall.assign(release=7, block="slab")
    ball.loc[5, ["x_m", "y_m"]] = np.nan
    return trajectories(pd.concat([ball, slab], ignore_index=True), FLOOR, BLOCKS)


def moments(image: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Area of the block (grey over contrast), its centroid (2,) and second moments (2, 2), in px."""
    weight = image.astype(float) - EVEN.background_grey
    v, u = np.mgrid[: image.shape[0], : image.shape[1]]
    centre = np.array([(weight * u).sum(), (weight * v).sum()]) / weight.sum()
    d = np.stack([u - centre[0], v - centre[1]])
    spread = np.einsum("iyx,jyx,yx->ij", d, d, weight) / weight.sum()
    return weight.sum() / (EVEN.block_grey - EVEN.background_grey), centre, spread


def test_coverage_is_the_exact_area_of_each_pixel():
    outline = np.array([[2.2, -3.1], [9.6, 1.3], [7.0, 6.5], [7.0, 8.0], [-2.4, 5.5]])
    left, top, right, bottom = 1, -1, 9, 7
    polygon, found = shapely.Polygon(outline), coverage([outline], (left, top, right, bottom))
    for v, u in itertools.product(range(top, bottom), range(left, right)):
        pixel = shapely.box(u - 0.5, v - 0.5, u + 0.5, v + 0.5)
        assert found[v - top, u - left] == pytest.approx(polygon.intersection(pixel).area, abs=1e-12)


@pytest.mark.parametrize("block", BLOCKS)
def test_centroid_and_area_of_the_picture_are_those_of_the_block(block):
    for shot in filmed(block, POSES):
        area, centre, _ = moments(shot.image)
        assert np.hypot(*(centre - shot.pose_px[:2])) < 0.003
        assert area == pytest.approx(BLOCKS[block].area_m2 / MAP.metres_per_pixel**2, rel=5e-4)


@pytest.mark.parametrize("block", ["slab", "egg"])
def test_principal_axis_is_the_angle(block):
    for shot in filmed(block, [(0.1 * MM, 0.2 * MM, theta) for theta in np.linspace(-4.0, 4.0, 9)]):
        _, _, spread = moments(shot.image)
        axis = 0.5 * np.arctan2(2 * spread[0, 1], spread[0, 0] - spread[1, 1])
        off = (axis - shot.pose_px[2] + np.pi / 2) % np.pi - np.pi / 2
        assert abs(np.rad2deg(off)) < 0.05


def test_rounded_corners_are_missing_from_the_picture():
    rounded = replace(BLOCKS["cube"], rounding_m=4 * MM)
    (shot,) = filmed("cube", POSES[1:2], blocks=BLOCKS | {"cube": rounded})
    expected = (rounded.area_m2 - (4 - np.pi) * rounded.rounding_m**2) / MAP.metres_per_pixel**2
    assert moments(shot.image)[0] == pytest.approx(expected, rel=5e-4)


@pytest.mark.parametrize("turn", [0.7, 2.0, -1.1])
def test_marks_of_the_sphere_turn_with_it(turn):
    marked = replace(EVEN, marked=("circle",))
    before, after = filmed("ball", [(0, 0, 0.3), (0, 0, 0.3 + turn)], look=marked)
    angle = after.pose_px[2] - before.pose_px[2]
    assert angle == pytest.approx(-turn)  # v grows downward
    c, s, about = np.cos(angle), np.sin(angle), np.array(before.pose_px[:2])
    turned = np.array([[c, -s], [s, c]])
    matrix = np.column_stack([turned, about - turned @ about])
    moved = cv2.warpAffine(before.image, matrix, SIZE, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    off, unturned = (np.abs(image.astype(float) - after.image).mean() for image in (moved, before.image))
    assert off < 0.3 < 2.0 < unturned


def test_marks_are_an_option():
    marked = filmed("cube", POSES[:1], look=replace(EVEN, marked=("square",)))[0]
    assert filmed("cube", POSES[:1])[0].image.min() == EVEN.background_grey
    assert marked.image.min() < EVEN.mark_grey + 20


def test_pixel_map_is_respected():
    high, low = filmed("ball", [(0, 10 * MM, 0), (0, -5 * MM, 0)], FLOOR)
    assert (high.pose_px[1], low.pose_px[1]) == (40.0, 70.0)
    assert high.image[110, 80] == EVEN.soil_grey and high.image[10, 80] == EVEN.background_grey
    inverted = filmed("ball", [(0, 10 * MM, 0.2)], FLOOR, pixel_map=replace(MAP, up=1))[0]
    assert inverted.pose_px == pytest.approx((80.0, 80.0, 0.2))
    assert inverted.image[10, 80] == EVEN.soil_grey and inverted.image[110, 80] == EVEN.background_grey


def test_picture_and_truth_respect_a_tilted_distorting_lens():
    bent = replace(MAP, tilt_rad=0.1, k=-0.02, centre_px=(80.0, 60.0), half_px=80.0)
    faces = shapely.segmentize(shapely.Polygon(BLOCKS["cube"].corners_m), 0.1 * MM)
    for shot in filmed("cube", [(20 * MM, 10 * MM, 0.3), (-20 * MM, -8 * MM, 0.9)], pixel_map=bent):
        x, y, theta = shot.pose_m
        assert shot.pose_px == pytest.approx((*bent.to_pixel(np.array([x, y])), -(theta + 0.1)))
        c, s = np.cos(theta), np.sin(theta)
        rim = bent.to_pixel(np.array(faces.exterior.coords) @ np.array([[c, s], [-s, c]]) + (x, y))
        assert moments(shot.image)[1] == pytest.approx(shapely.Polygon(rim).centroid.coords[0], abs=0.003)


def test_rest_frames_are_empty_and_frames_are_numbered_through():
    shots = list(film_frames(two_releases(), MAP, SIZE, FilmOptions(seed=1, rest_frames=4)))
    assert [shot.frame for shot in shots] == [n for n in range(88) if n not in (4 + 3, 4 + 5)]
    assert [shot.release for shot in shots] == [3] * 42 + [7] * 44
    rest = [shot for shot in shots if shot.pose_px is None]
    assert [shot.frame for shot in rest] == [0, 1, 2, 3, 44, 45, 46, 47]
    assert all(np.array_equal(shot.image, rest[0].image) for shot in rest)
    assert [round(1000 * shot.t_s) for shot in shots[:6]] == [-4, -3, -2, -1, 0, 1]


def test_out_of_the_picture_there_is_no_pose():
    inside, across, outside = filmed("ball", [(0, 0, 0), (40 * MM, 0, 0), (60 * MM, 0, 0)])
    assert across.pose_px is not None and across.image[60, -1] == EVEN.block_grey
    assert outside.pose_px is None and outside.pose_m is None and np.ptp(outside.image) == 0
    assert inside.frame == 0 and outside.frame == 2


@pytest.mark.parametrize("faults", [MODERATE, SEVERE])
def test_the_same_seed_makes_the_same_film(faults):
    one, same, other = (
        list(film_frames(two_releases(), MAP, SIZE, FilmOptions(faults=faults, seed=s))) for s in (5, 5, 6)
    )
    assert [shot.frame for shot in one] == [shot.frame for shot in same]
    assert all(np.array_equal(a.image, b.image) for a, b in zip(one, same, strict=True))
    assert not np.array_equal(one[0].image, other[0].image)


def test_dropped_frames_keep_their_numbers():
    whole = {shot.frame: shot for shot in film_frames(two_releases(), MAP, SIZE, FilmOptions(seed=1))}
    left = list(film_frames(two_releases(), MAP, SIZE, FilmOptions(seed=1, faults=Faults(dropped=0.3))))
    assert 0.5 < len(left) / len(whole) < 0.85
    others = film_frames(two_releases(), MAP, SIZE, FilmOptions(seed=2, faults=Faults(dropped=0.3)))
    assert [shot.frame for shot in others] != [shot.frame for shot in left]
    for shot in left:
        same = whole[shot.frame]
        assert (shot.t_s, shot.release, shot.pose_px) == (same.t_s, same.release, same.pose_px)
        assert np.array_equal(shot.image, same.image)


def test_burial_hides_what_is_below_and_nothing_in_flight():
    sunk, high = (0.0, 0.0, 0.2), (0.0, 20 * MM, 0.2)  # the ball reaches 5 px below the surface at v = 80
    look = replace(EVEN, texture_grey=10.0)
    bare = filmed("ball", [sunk, high], FLOOR, look=look)
    buried = filmed("ball", [sunk, high], FLOOR, look=look, faults=Faults(burial_radii=0.4))
    still = filmed("ball", [(1.0, 0, 0)], FLOOR, look=look)[0].image
    heap = 70  # 0.4 of 25 px above the surface
    assert (bare[0].image[heap:82, 75:86] == EVEN.block_grey).all()
    assert buried[0].image[heap + 4 :, 60:100].max() < 180  # soil, where the block was
    assert np.array_equal(buried[0].image[84:], still[84:])
    assert np.array_equal(buried[0].image[: heap - 4], bare[0].image[: heap - 4])
    assert np.array_equal(buried[1].image, bare[1].image)


def test_shadow_darkens_soil_alone_and_less_from_high_up():
    low, high = filmed("ball", [(0, 5 * MM, 0), (0, 15 * MM, 0)], FLOOR, faults=Faults(shadow=0.5))
    bare = filmed("ball", [(0, 5 * MM, 0)], FLOOR)[0]
    assert np.array_equal(low.image[:77], bare.image[:77])
    assert low.image[84, 80] < high.image[84, 80] < EVEN.soil_grey
    assert low.image[84, 5] == EVEN.soil_grey


def test_impacts_are_found_where_the_block_bounces():
    t = np.arange(400) / 1000.0
    height = np.abs(0.12 * np.cos(np.pi * t / 0.2))  # bounces at 0.1 s and 0.3 s
    noisy = height + np.random.default_rng(0).normal(0.0, 3e-4, len(t))
    for y in (height, noisy):
        rows, jumps = zip(*vertical_jumps(t, y, 3e-4), strict=True)
        assert np.array(rows) == pytest.approx([100, 300], abs=2)
        assert np.array(jumps) == pytest.approx(2 * 0.12 * np.pi / 0.2, rel=0.1)
    assert not list(vertical_jumps(t, 1 + t - 4.9 * t**2, 0.0))


def test_dust_rises_at_the_impact_and_fades():
    t = np.arange(700) / 1000.0
    y = np.abs(0.1 - t) - 0.01
    x = np.where(t < 0.15, 0.0, 1.0)  # gone, so that only dust is seen
    shots = filmed("ball", np.column_stack([x, y, 0 * t]), FLOOR, faults=Faults(dust=0.5))
    brighter = np.array([shot.image[50:78, 40:120].mean() for shot in shots]) - EVEN.background_grey
    assert np.ptp([shot.image[90:].mean() for shot in shots[:60]]) < 0.01
    assert brighter[160] > 5.0 and brighter[690] < 0.3 * brighter[160]


def test_open_shutter_smears_along_the_motion_about_the_truth():
    path = [(4 * MM * i, 0.0, 0.0) for i in range(-2, 3)]  # 8 px a frame
    sharp, smeared = filmed("ball", path)[2], filmed("ball", path, faults=Faults(shutter=0.5))[2]
    _, centre, spread = moments(smeared.image)
    wider = spread - moments(sharp.image)[2]
    assert centre == pytest.approx(smeared.pose_px[:2], abs=0.003)
    assert wider[0, 0] == pytest.approx(4.0**2 / 12, abs=0.05) and abs(wider[1, 1]) < 0.05


def test_defocus_blurs_without_moving():
    sharp, soft = (filmed("ball", POSES[:1], faults=Faults(defocus_px=r))[0] for r in (0.0, 2.0))
    assert moments(soft.image)[1] == pytest.approx(soft.pose_px[:2], abs=0.003)
    wider = moments(soft.image)[2] - moments(sharp.image)[2]
    assert np.diag(wider) == pytest.approx([1.0, 1.0], abs=0.2)  # r² / 4 of a disc


def test_noise_has_the_size_that_is_stated():
    faults = Faults(noise_grey=3.0, shot_noise=0.1)
    shots = filmed("ball", POSES[:1] * 20, FLOOR, faults=faults)
    stack = np.array([shot.image for shot in shots], float)
    for spot, grey in ((stack[:, 5:25], EVEN.background_grey), (stack[:, 95:115], EVEN.soil_grey)):
        assert spot.mean() == pytest.approx(grey, abs=0.1)
        assert spot.std() == pytest.approx(np.sqrt(9.0 + 0.1 * grey), rel=0.03)
        assert abs(np.corrcoef(spot[0].ravel(), spot[1].ravel())[0, 1]) < 0.06


def test_flicker_swings_at_100_hz_and_contrast_falls():
    shots = filmed("ball", POSES[:1] * 20, faults=Faults(flicker=0.1, low_contrast=0.4))
    light = np.array([shot.image[5, 5] for shot in shots], float) / EVEN.background_grey
    assert light[:10] == pytest.approx(light[10:], abs=0.02)
    assert np.ptp(light) == pytest.approx(0.2, abs=0.03)
    contrast = [shot.image[60, 80] / (shot.image[5, 5] or 1) for shot in shots]
    assert np.mean(contrast) == pytest.approx(1 + 0.6 * (215 - 62) / 62, rel=0.02)


@pytest.mark.parametrize("quality", [None, 90])
def test_film_and_truth_are_read_back(tmp_path, quality):
    shots = list(film_frames(two_releases(), MAP, SIZE, FilmOptions(seed=1)))
    path = write_film(tmp_path / "new" / "film.avi", shots, SIZE, 25, quality)
    video, images = cv2.VideoCapture(str(path)), []
    while (read := video.read())[0]:
        images.append(read[1][..., 0])
    off = np.abs(np.array(images, float) - [shot.image for shot in shots])
    assert off.max() == 0 if quality is None else 0 < off.mean() < 4
    truth = pd.read_csv(path.with_suffix(".csv"))
    assert tuple(truth.columns) == TRUTH_COLUMNS and len(truth) == len(shots)
    assert truth["frame"].tolist() == [shot.frame for shot in shots]
    seen = truth.dropna()
    assert MAP.to_pixel(seen[["x_m", "y_m"]].to_numpy()) == pytest.approx(seen[["u_px", "v_px"]].to_numpy())
    assert sorted(file.name for file in path.parent.iterdir()) == ["film.avi", "film.csv"]


def test_quality_costs_room_and_compression_sets_it(tmp_path):
    shots = list(film_frames(two_releases(), MAP, SIZE, FilmOptions(seed=1, faults=Faults(noise_grey=3))))
    sizes = [write_film(tmp_path / f"{q}.avi", shots, SIZE, 25, q).stat().st_size for q in (90, 20)]
    assert sizes[1] < 0.7 * sizes[0]
    assert (Faults().quality, Faults(compression=0.3).quality, Faults(compression=1).quality) == (None, 70, 1)


def test_a_film_is_whole_or_not_there(tmp_path):
    def broken():
        yield from itertools.islice(film_frames(two_releases(), MAP, SIZE, FilmOptions(seed=1)), 3)
        raise RuntimeError

    with pytest.raises(RuntimeError):
        write_film(tmp_path / "film.avi", broken(), SIZE, 25)
    shots = list(itertools.islice(film_frames(two_releases(), MAP, SIZE, FilmOptions(seed=1)), 3))
    with pytest.raises(InputError, match="expected a film as"):
        write_film(tmp_path / "film.mp4", shots, SIZE, 25)
    with pytest.raises(InputError, match="even width"):
        write_film(tmp_path / "film.avi", shots, (161, 120), 25)
    with pytest.raises(InputError, match="120 x 160 px, found 160 x 120"):
        write_film(tmp_path / "film.avi", shots, (120, 160), 25)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("quality", [None, 90])
@pytest.mark.parametrize("share", [0.1, 0.9])
def test_a_film_that_finds_no_room_is_not_there(tmp_path, quality, share):
    shots = list(film_frames(two_releases(), MAP, SIZE, FilmOptions(seed=1)))
    whole = write_film(tmp_path / "whole.avi", shots, SIZE, 25, quality)
    with short_files(int(share * whole.stat().st_size)), pytest.raises(OSError, match=r"cut\.(avi|csv)"):
        write_film(tmp_path / "cut.avi", shots, SIZE, 25, quality)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["whole.avi", "whole.csv"]


def test_what_cannot_be_filmed_is_refused():
    experiment = two_releases()
    with pytest.raises(InputError, match="no release 4"):
        film_frames(experiment, MAP, SIZE, FilmOptions(seed=1, releases=[3, 4]))
    with pytest.raises(InputError, match="two rows within a frame at 500"):
        film_frames(replace(experiment, fps=500.0), MAP, SIZE, FilmOptions(seed=1))
    hits = replace(experiment, trajectories=None, impacts=pd.DataFrame())
    with pytest.raises(InputError, match="only trajectories"):
        film_frames(hits, MAP, SIZE, FilmOptions(seed=1))
    with pytest.raises(InputError, match="fault dust: expected 0 to 1, found"):
        Faults(dust=1.5)
