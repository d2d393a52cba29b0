"""What the camera makes of the world: each effect by itself, and back again."""

import numpy as np
import pytest

from rock2d.effects.changes import aim_and_width
from rock2d.scene.world import View
from tests.effects.worlds import CATALOGUE, neutral, run, typical, with_effect, world
from tests.laboratory import SETUP

CAMERA = [name for name, effect in CATALOGUE.items() if effect.camera]
POSES = np.random.default_rng(4).uniform([-0.1, 0.0, -3], [0.4, 0.3, 3], (50, 3))


def values(name: str, share: float) -> list[float]:
    choices = CATALOGUE[name].parameters[0].choices
    return [choices[0]] if choices else typical(name, share)


@pytest.mark.parametrize("name", CAMERA)
@pytest.mark.parametrize("share", [-1.0, 0.3, 1.0])
def test_what_was_recorded_can_be_taken_back(name, share):
    view = with_effect(world(), name, values(name, share)).view
    assert view.true(view.record(POSES)) == pytest.approx(POSES, abs=1e-12)


@pytest.mark.parametrize("name", CAMERA)
def test_a_camera_effect_leaves_the_motion_alone(name):
    changed = with_effect(world(), name, values(name, 0.5))
    state = np.array([[0.05, 0.08, 0.3, 1.0, -1.5, -20.0]])
    assert np.array_equal(run(changed, state, impact_limit=1).ends, run(world(), state, impact_limit=1).ends)
    assert changed.view != world().view


@pytest.mark.parametrize("name", CAMERA)
def test_a_recorded_length_is_worth_what_the_records_derivatives_say(name):
    """Noise that is 1 in every recorded direction has the covariance (J Jᵀ)⁻¹ for the record's Jacobian J."""
    view = with_effect(with_effect(world(), "camera_tilt", [0.1, 0.2, 0.1]), name, values(name, -1.0)).view
    ahead, behind = (view.record(POSES[:, None] + h * np.eye(3)[:2]) for h in (1e-5, -1e-5))
    inverse = np.linalg.inv((ahead - behind)[..., :2].transpose(0, 2, 1) / 2e-5)
    direction = np.array([np.cos(0.7), np.sin(0.7)])
    expected = np.linalg.norm(np.einsum("i,nij->nj", direction, inverse), axis=1)
    found = view.true_per_recorded(POSES, np.tile(direction, (len(POSES), 1)))
    assert found == pytest.approx(expected, rel=1e-6)


def test_a_slanting_camera_shows_what_a_pinhole_does():
    """A camera turned by 6° about the vertical and 4° about the horizontal, by the pinhole's own equations: positions
    agree but for the camera's own roll and scale, and a small body appears turned by the rotation of the picture."""
    yaw, pitch, far = 0.1, 0.07, 1.2
    ahead = np.array([np.sin(yaw) * np.cos(pitch), np.sin(pitch), -np.cos(yaw) * np.cos(pitch)])
    right = np.cross(ahead, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(right, ahead), ahead])

    def picture(points):
        seen = (np.column_stack([points, np.zeros(len(points))]) + far * ahead) @ axes.T
        return far * seen[:, :2] / seen[:, 2:]

    view = View(keystone_per_m=(ahead[0] / far, ahead[1] / far))
    ours = view.record(np.column_stack([POSES[:, :2], np.zeros(len(POSES))]))
    # an affine map about the middle: scales along x and y and the shear between them are second order in the angles
    affine, *_ = np.linalg.lstsq(ours[:, :2], picture(POSES[:, :2]), rcond=None)
    assert ours[:, :2] @ affine == pytest.approx(picture(POSES[:, :2]), abs=1e-12)
    ends = [view.record(np.column_stack([POSES[:, :2] + step, np.zeros(len(POSES))])) for step in 1e-6 * np.eye(2)]
    along_x, along_y = ((end - ours)[:, :2] for end in ends)
    turned = np.arctan2(along_x[:, 1] - along_y[:, 0], along_x[:, 0] + along_y[:, 1])
    assert ours[:, 2] == pytest.approx(turned, abs=1e-6)
    assert np.abs(ours[:, 2]).max() > 0.01


def test_every_axis_can_be_mirrored():
    for axis in (1, 2, 3):
        recorded = with_effect(world(), "mirrored_axis", [axis]).view.record(POSES)
        sign = np.ones(3)
        sign[axis - 1] = -1
        assert recorded == pytest.approx(POSES * sign, abs=1e-15)


def test_tilt_turns_gravity_in_the_picture():
    """A free fall seen by a camera turned by +τ falls along (sin τ, -cos τ)."""
    tilt = with_effect(world(), "camera_tilt", [0.1, 0.0, 0.0]).view
    fall = np.array([[0.1, 0.2, 0.0], [0.1, 0.1, 0.0]])
    way = np.diff(tilt.record(fall), axis=0)[0]
    assert way[:2] == pytest.approx(0.1 * np.array([np.sin(0.1), -np.cos(0.1)]))


def test_scale_and_frame_rate_change_the_gravity_that_is_seen():
    """g as recorded is g × scale × time_scale²: position = scale × true, time = true / time_scale."""
    scale, clock = 1.05, 0.95
    view = with_effect(with_effect(world(), "scale_error", [scale, 1, 0, 0]), "frame_rate_error", [clock]).view
    t = np.linspace(0, 0.2, 30)
    poses = np.column_stack([0 * t, -0.5 * 9.81 * t**2, 0 * t])
    seen = np.polyfit(t / view.time_scale, view.record(poses)[:, 1], 2)[0]
    assert -2 * seen == pytest.approx(9.81 * scale * clock**2, rel=1e-9)


def test_a_slanting_view_foreshortens_x_alone():
    view = with_effect(world(), "scale_error", [1.02, 0.99, 0.0, 0.0]).view
    steps = np.diff(view.record(np.array([[0.1, 0.2, 0.0], [0.2, 0.2, 0.0], [0.2, 0.3, 0.0]])), axis=0)
    assert steps == pytest.approx(0.1 * np.array([[1.02 * 0.99, 0, 0], [0, 1.02, 0]]), abs=1e-15)


def test_a_point_that_a_lens_cannot_record_lies_at_its_fold():
    """r (1 + k r²) with k < 0 is largest at r = 1 / √(−3 k): 2/3 of that r."""
    view = View(lens_per_m2=-3.0)
    fold = 1.0 / 3.0
    poses = np.array([[0.99 * fold, 0.0, 0.0], [0.0, -0.5 * fold, 0.0]])
    beyond = np.array([[0.7 * fold, 0.0, 0.0], [0.0, -100.0, 0.0]])
    found = view.true(np.concatenate([view.record(poses), beyond]))
    assert found[:2] == pytest.approx(poses, abs=1e-9)
    assert found[2:] == pytest.approx(np.array([[fold, 0.0, 0.0], [0.0, -fold, 0.0]]), rel=1e-5)


def test_distortion_grows_with_the_third_power_of_the_distance_from_the_axis():
    (x, y), width = aim_and_width(SETUP)
    view = with_effect(world(), "lens_distortion", [0.04, 0.0, 0.0]).view
    out = [view.record(np.array([x + d * width, y, 0.0]))[0] - (x + d * width) for d in (0.5, 1.0)]
    assert out == pytest.approx([0.04 * width / 8, 0.04 * width], rel=1e-9)


@pytest.mark.parametrize("name", CAMERA)
def test_a_neutral_camera_records_what_is(name):
    assert with_effect(world(), name, neutral(name)).view.record(POSES) == pytest.approx(POSES, abs=1e-15)


@pytest.mark.parametrize(
    ("place", "later"), [([0.0, 0.0], [0.0, 0.0]), ([0.4, -0.3], [0.0, 0.0]), ([0.4, 0], [0.2, 1])]
)
def test_a_keystone_is_no_error_of_the_scale(place, later):
    """In the middle of the set-up a small body keeps its area, wherever the camera aims at, also if another effect
    moves its aim afterwards."""
    slanting = with_effect(world(), "keystone_distortion", [0.1, -0.15, *place])
    view = with_effect(slanting, "lens_distortion", [0.0, *later]).view
    middle, _ = aim_and_width(world().cross_section)
    at = np.array([*middle, 0.0])
    ahead, behind = (view.record(at + step * np.eye(3)[:2]) for step in (1e-5, -1e-5))
    assert np.linalg.det((ahead - behind)[:, :2] / 2e-5) == pytest.approx(1.0, rel=1e-6)


def test_the_camera_slants_the_picture_before_it_is_turned_and_scaled_about_another_point():
    """A keystone is an effect of the optics; rotation and scale of the picture depend on how it was placed, so each
    has a point of its own that stays."""
    optics = with_effect(world(), "keystone_distortion", [0.1, -0.15, 0.5, 0.2])
    placed, both = world(), optics
    for effect in (("camera_tilt", [0.06, 0.3, -0.2]), ("scale_error", [0.97, 1.01, 0.1, 0.4])):
        placed, both = with_effect(placed, *effect), with_effect(both, *effect)
    assert both.view.record(POSES) == pytest.approx(placed.view.record(optics.view.record(POSES)), abs=1e-12)
    assert both.view.true(both.view.record(POSES)) == pytest.approx(POSES, abs=1e-12)


def test_a_lens_distorts_about_the_image_of_the_axis_wherever_the_picture_was_placed():
    """Along a ray from the image of the axis, points stay on the ray."""
    view = with_effect(with_effect(world(), "lens_distortion", [0.04, 0.3, 0.1]), "scale_error", [0.9, 1.0, 0, 0]).view
    axis = np.array([*view.axis_m, 0.0])
    at = view.record(axis + np.outer([0.0, 0.05, 0.1, 0.2], [0.6, 0.8, 0.0]))[:, :2]
    out = np.linalg.norm(at - at[0], axis=1)
    assert at - at[0] == pytest.approx(np.outer(out, [0.6, 0.8]), abs=1e-12)
    assert out / (0.9 * np.array([1.0, 0.05, 0.1, 0.2])) - 1.0 == pytest.approx(
        [-1.0, *view.lens_per_m2 * (0.9 * np.array([0.05, 0.1, 0.2])) ** 2], abs=1e-9
    )
