"""A block at rest lies on the ground: its pose shows ground, scale and tracked angle without any law of contact."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from rock2d.diagnosis.data import FilmData
from rock2d.effects import catalogue
from rock2d.files.experiment import Experiment
from rock2d.kinematics.film_findings import rest_heights, rest_remarks
from rock2d.kinematics.flights import load_film
from rock2d.kinematics.rest_poses import SHARED_ANGLE_RAD, SHARED_HEIGHT_RADII, RestPoses, heights_and_angles
from rock2d.kinematics.setup_world import setup_world
from rock2d.scene.blocks import make_block
from rock2d.scene.cross_section import CrossSection
from rock2d.scene.world import World

BALL = make_block("ball", "circle", 0.2, "solid_sphere", diameter_m=0.06)
SQUARE = make_block("square", "square", 0.2, "uniform", side_m=0.06)
INCLINE = 0.2  # rise of the ground along x
NOISE_M, NOISE_RAD = 1e-4, 2e-3
FRAMES = 40  # of the fall, and of the rest


def lying(releases: int, view: World | None = None, *, moves_m: float = 0.0) -> Experiment:
    """Releases of a ball and of a square that fall 1 m and then lie on an inclined ground, as the camera of `view`
    records them; `moves_m`: way of the blocks in the last frames."""
    rng, fps = np.random.default_rng(np.random.SeedSequence(5)), 100.0
    t, rows, angle = np.arange(2 * FRAMES) / fps, [], np.arctan(INCLINE)
    for k in range(2 * releases):
        block, place = (BALL, SQUARE)[k % 2], rng.uniform(-0.4, 0.4)
        side = 0.03 * np.array([-np.sin(angle), np.cos(angle)])
        rest = np.array([place, INCLINE * place]) + side
        pose = np.tile([*rest, angle + (k % 4) * np.pi / 2], (len(t), 1))
        pose[:FRAMES, 1] += 1.0 - 4.905 * t[:FRAMES] ** 2
        pose[FRAMES:, 0] += np.linspace(0.0, moves_m, FRAMES)
        pose = pose if view is None else view.view.record(pose)
        pose = pose + rng.normal(size=pose.shape) * [NOISE_M, NOISE_M, NOISE_RAD]
        names = {"release": k, "block": block.name, "t_s": t}
        rows.append(pd.DataFrame(names | dict(zip(("x_m", "y_m", "theta_rad"), pose.T, strict=True))))
    ground = CrossSection([[-1.0, -INCLINE], [1.0, INCLINE]], ["floor"])
    blocks = {"ball": BALL, "square": SQUARE}
    return Experiment("rest", 9.81, fps, NOISE_M, NOISE_RAD, ground, blocks, trajectories=pd.concat(rows))


def rests_of(experiment: Experiment) -> tuple[World, RestPoses]:
    world = setup_world(experiment)
    return world, RestPoses.of(load_film(experiment), world)


def recorded_with(name: str, values: list[float], releases: int) -> tuple[World, World, RestPoses]:
    """The stated world, the true one with an effect of the camera, and the rests as the camera records them."""
    true = catalogue()[name].apply(setup_world(lying(1)), values)
    stated, rests = rests_of(lying(releases, true))
    return stated, true, rests


def test_rests_on_the_stated_ground_leave_no_residual():
    world, rests = rests_of(lying(200))
    assert len(rests) == 400
    z = rests.residuals(world)
    assert z.shape == (2, 3)
    assert np.abs(z).max() < 0.3  # what all rests share is far larger than the error of 200
    assert z[0, 1] == 0.0  # a ball has no sides


def test_the_tracked_angle_shows_in_the_sides_on_which_squares_lie():
    """However many rests there are, their mean counts only as far as the accuracy of the sides allows."""
    offset = np.deg2rad(2.0)
    stated, true, rests = recorded_with("angle_offset", [offset], 300)
    found = heights_and_angles(stated, rests.block, rests.pose)[rests.block == 1, 1]
    assert abs(found.mean()) == pytest.approx(offset, rel=0.02)
    assert np.abs(rests.residuals(stated)[1, 1]) == pytest.approx(offset / SHARED_ANGLE_RAD, rel=0.03)
    assert np.abs(rests.residuals(true)).max() < 0.3


def test_a_wrong_scale_lifts_blocks_off_the_ground_and_a_turned_camera_inclines_the_line_of_rests():
    stated, true, rests = recorded_with("scale_error", [1.04, 1.0, 0.0, 0.0], 300)
    shared = SHARED_HEIGHT_RADII * stated.radii_m[0]
    assert rests.residuals(stated)[0, 0] == pytest.approx(0.04 * 0.03 / shared, rel=0.05)
    assert np.abs(rests.residuals(true)).max() < 0.3
    stated, true, rests = recorded_with("camera_tilt", [0.01, 0.0, 0.0], 300)
    turned = rests.residuals(stated)
    assert np.abs(turned[:, 2]) == pytest.approx(0.01 * (1.0 + INCLINE**2) ** 0.5 / SHARED_ANGLE_RAD, rel=0.1)
    assert np.abs(turned[1, 1]) == pytest.approx(0.01 / SHARED_ANGLE_RAD, rel=0.05)
    assert np.abs(rests.residuals(true)).max() < 0.3


def test_blocks_that_move_or_are_few_are_no_rests():
    assert not len(rests_of(lying(20, moves_m=0.02))[1])
    assert not len(rests_of(lying(4))[1])


def test_a_film_has_a_row_of_residuals_for_the_rests_of_each_block():
    experiment = lying(10)
    falls = replace(experiment, trajectories=experiment.trajectories.query("t_s < 0.4"))
    for own, rows in ((experiment, 2), (falls, 0)):
        data = FilmData.of(load_film(own), setup_world(own))
        assert data.flown == 20
        assert len(data.residuals(setup_world(own)).flights) == len(data.flight_release) == 20 + rows


@pytest.mark.parametrize("kept", [np.arange(20) < 6, np.arange(20) > 0, np.arange(20) > 5])
def test_a_part_of_a_film_has_the_rows_of_its_releases(kept):
    experiment = lying(10)
    data = FilmData.of(load_film(experiment), setup_world(experiment))
    assert (data.only(kept).flight_release == data.flight_release[kept[data.flight_release]]).all()


def test_a_wrong_angle_at_rest_is_told():
    true = catalogue()["angle_offset"].apply(setup_world(lying(1)), [0.03])
    for view, told in ((true, ["square"]), (None, [])):
        experiment = lying(20, view)
        world = setup_world(experiment)
        remarks = rest_remarks(FilmData.of(load_film(experiment), world), world)
        assert [
            name for line in remarks for name in ("ball", "square") if f"block {name} lies is turned" in line
        ] == told


def test_the_height_at_rest_does_not_depend_on_the_tracked_angle():
    """A square that seems to stand on a corner by 2° lies on its side all the same."""
    true = catalogue()["angle_offset"].apply(setup_world(lying(1)), [np.deg2rad(2.0)])
    experiment = lying(20, true)
    for own in rest_heights(load_film(experiment), setup_world(experiment)):
        assert own.error_m is not None
        assert own.height_m == pytest.approx(0.0, abs=4.0 * own.error_m)
        assert own.error_m < 0.05 * 0.03 * np.deg2rad(2.0)  # half of the side, times the angle: the corner's height
