"""From film to experiment: where blocks were, how they turned, how fast they went, against a film of known truth."""

import copy
import re
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
from rock2d_tracking.arcs import Arc
from rock2d_tracking.candidates import CANDIDATE
from rock2d_tracking.film_reading import CONSTANT_RATE
from rock2d_tracking.following import Follower, releases_shown
from rock2d_tracking.looks import Looks
from rock2d_tracking.motion import Chain, Motion
from rock2d_tracking.outline import outline_of
from rock2d_tracking.setup_file import Setup, write_setup
from rock2d_tracking.sights import FollowedRelease, Sight, lost_sight
from rock2d_tracking.synthetic.faults import CLEAN, MODERATE, Faults
from rock2d_tracking.synthetic.film import FilmOptions, Shot, film_frames
from rock2d_tracking.tracked_film import TrackedFilm, moving_releases, remarks_on_names, tracked_film

from rock2d.files.experiment import Experiment
from rock2d.kinematics.flight_gravity import Measured
from tests.programs import refusal
from tests.tracking.falls import BLOCKS, CAMERA, CROSS_SECTION, SIZE_PX, SYMMETRY, falls, followed

cv2.setNumThreads(1)
NOISY = Faults(noise_grey=3.0, shot_noise=0.05)


@dataclass
class Tracked:
    """A film of known truth and what was made of it."""

    experiment: Experiment
    shots: list[Shot]
    pictures: list[list[int]]  # for each release: which pictures of the film its frames are
    releases: list[FollowedRelease]
    film: TrackedFilm
    setup: Setup

    def misses(self, block: str) -> tuple[np.ndarray, np.ndarray]:
        """Distance in px and angle in rad by which each trusted frame of a block is off."""
        far, turn = [], []
        for release, pictures in zip(self.releases, self.pictures, strict=True):
            if release.block != block:
                continue
            off = []
            for sight, picture in zip(release.sights, pictures, strict=True):
                truth = self.shots[picture].pose_px
                if not sight.reason:
                    assert truth is not None, f"picture {picture} shows no block"
                    far.append(np.hypot(*(sight.pose[:2] - truth[:2])))
                    off.append(sight.pose[2] - truth[2])
            start = off[0] if block == "sphere" else 0.0  # its marks have no zero
            turn.append(np.array(off) - start)
        every = np.concatenate(turn)
        half = 0.5 * SYMMETRY[block]
        return np.array(far), (every + half) % (2 * half) - half


def film_in(releases: list[FollowedRelease], setup: Setup) -> TrackedFilm:
    """The experiment that releases show."""
    return tracked_film(moving_releases(releases, setup.g_px_frame2), len(releases), setup, SIZE_PX)


def stated_setup(path: Path) -> Setup:
    """A set-up that states one release of each block."""
    stated = Experiment("film", 9.81, 1000.0, 0.0, 0.0, CROSS_SECTION, BLOCKS, impacts=pd.DataFrame())
    write_setup(path, stated, CAMERA, ["sphere", "cube", "slab"])
    return Setup(path)


def chain(first: int, last: int, area_px2: float = 500.0) -> Chain:
    """One arc, in every frame."""
    frames = np.arange(first, last + 1)
    still, areas = np.zeros((len(frames), 2)), np.full(len(frames), area_px2)
    fall = (True, False, Measured(1.0, 0.1), 1.0, 50.0, 0.0)
    return Chain([Arc(frames, still, areas, np.zeros((3, 2)), 0.0, CONSTANT_RATE, *fall)])


@pytest.fixture(scope="module")
def tracked(tmp_path_factory):
    """A film with some faults, tracked."""
    path = tmp_path_factory.mktemp("setup") / "setup.yaml"
    write_setup(path, falls(), CAMERA, ["sphere", "cube", "slab"])
    setup = Setup(path)

    @cache
    def make(faults: Faults, frames: int = 220) -> Tracked:
        experiment = falls(frames)
        shots = list(film_frames(experiment, CAMERA, SIZE_PX, FilmOptions(seed=3, faults=faults, rest_frames=40)))
        releases = followed([s.image for s in shots], setup, SIZE_PX).releases
        pictures = [[s.frame for s in r.sights] for r in releases]
        return Tracked(experiment, shots, pictures, releases, film_in(releases, setup), setup)

    return make


@pytest.mark.parametrize("block", ["sphere", "cube", "slab"])
def test_a_clean_film_is_followed_to_a_twentieth_of_a_pixel(tracked, block):
    far, turn = tracked(CLEAN).misses(block)
    assert len(far) == 220
    assert np.sqrt((far**2).mean() / 2) < 0.05
    assert np.rad2deg(np.sqrt((turn**2).mean())) < 0.3


@pytest.mark.parametrize("block", ["sphere", "cube", "slab"])
def test_a_spoiled_film_is_followed_and_no_frame_is_far_off(tracked, block):
    far, turn = tracked(MODERATE).misses(block)
    assert len(far) > 200
    assert np.sqrt((far**2).mean() / 2) < 0.3
    assert np.rad2deg(np.sqrt((turn**2).mean())) < 1.5
    assert far.max() < 2.0


@pytest.mark.parametrize("factor", [0.97, 1.03])
def test_a_size_that_is_stated_wrong_is_corrected(tracked, tmp_path, factor):
    found, path = tracked(CLEAN), tmp_path / "setup.yaml"
    sizes = re.compile(r"(diameter_m|side_m|length_m|height_m): ([\d.e-]+)")
    text = sizes.sub(lambda m: f"{m[1]}: {float(m[2]) * factor:.9g}", found.setup.path.read_text())
    path.write_text(text)
    again = followed([s.image for s in found.shots], Setup(path), SIZE_PX)
    assert [len(r.seen) for r in again.releases] == [220, 220, 220]
    for looks in again.looks.values():
        assert looks.size * factor == pytest.approx(1.0, abs=0.005)


def test_releases_of_one_film_are_told_apart(tracked):
    found = tracked(CLEAN)
    assert [release.block for release in found.releases] == ["sphere", "cube", "slab"]
    assert [(p[0], p[-1]) for p in found.pictures] == [(40, 259), (300, 519), (560, 779)]


def test_frames_that_the_film_dropped_are_counted(tracked):
    found = tracked(Faults(dropped=0.04), frames=130)
    for release, pictures in zip(range(3), found.pictures, strict=True):
        own = found.film.frames[found.film.frames["release"] == release]
        true = np.array([found.shots[k].frame for k in pictures])
        late = np.diff(true - own["frame"].to_numpy())
        # a frame that is dropped on the first or last frames shows nothing
        assert np.abs(late).sum() <= 2
    assert any("missing in the film" in remark for remark in found.film.remarks)


def _velocity_errors(found: Tracked) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) of vx, vy (m/s), omega (rad/s) of all flights: errors, and stated standard errors."""
    flights = found.film.flights
    truth = found.experiment.trajectories
    errors, stated = [], []
    for _, row in flights.iterrows():
        own = truth[(truth["release"] == row.release)]
        own = own[(own["t_s"] >= row.begin_s - 1e-9) & (own["t_s"] <= row.end_s + 1e-9)]
        dt = (own["t_s"] - row.t_s).to_numpy()
        motion = (own["x_m"], own["y_m"] + 0.5 * 9.81 * dt**2, own["theta_rad"])
        exact = [np.polyfit(dt, value, 1)[0] for value in motion]
        names = ("vx_m_s", "vy_m_s", "omega_rad_s")
        errors.append([row[name] - v for name, v in zip(names, exact, strict=True)])
        stated.append([row[f"{name}_se"] for name in names])
    return np.array(errors), np.array(stated)


def test_velocities_of_a_clean_film_are_exact(tracked):
    errors, _ = _velocity_errors(tracked(CLEAN))
    assert len(errors) >= 6
    assert np.abs(errors[:, :2]).max() < 1e-3 and np.abs(errors[:, 2]).max() < 0.1


def test_velocities_are_off_by_as_much_as_is_stated(tracked):
    errors, stated = _velocity_errors(tracked(NOISY))
    assert 0.6 < np.sqrt(((errors / stated) ** 2).mean()) < 1.5


def test_impacts_are_the_breaks_between_flights(tracked):
    impacts = tracked(CLEAN).film.impacts
    assert len(impacts) >= 3
    assert (impacts["penetration_m"] >= 0).all() and set(impacts["flag"]) <= {"", "deep", "low", "deep low"}
    first = impacts.iloc[0]
    assert first["vy_m_s"] < 0 < first["vy_after_m_s"]


def test_the_experiment_states_the_noise_that_its_flights_show(tracked):
    calm, noisy = tracked(CLEAN), tracked(NOISY)
    a, b = calm.film.experiment, noisy.film.experiment
    assert 0 < a.position_noise_m < b.position_noise_m < 0.05 * CAMERA.metres_per_pixel
    far, _ = noisy.misses("cube")
    assert np.sqrt((far**2).mean() / 2) * CAMERA.metres_per_pixel == pytest.approx(b.position_noise_m, rel=0.8)


def test_what_never_moves_is_no_release(tracked):
    found = tracked(CLEAN)
    still = [FollowedRelease("cube", [replace(found.releases[1].seen[0], frame=k) for k in range(30)])]
    again = film_in([*copy.deepcopy(found.releases), *still], found.setup)
    assert again.experiment.trajectories["release"].nunique() == 3
    said = "1 of 4 objects that were followed never moved, or were trusted in fewer than 8 frames, and are left out"
    assert said in again.remarks


def test_an_object_that_never_moves_takes_no_name_from_a_release(tracked):
    """A block lies in the picture for a while before the first release."""
    found = tracked(CLEAN)
    pictures = [s.image for start in (0, 260, 520) for s in found.shots[start : start + 140]]
    pictures[8:34] = [pictures[60]] * 26
    releases = followed(pictures, found.setup, SIZE_PX).releases
    assert len(releases) == 4 and np.ptp([s.pose[0] for s in releases[0].seen]) < 0.1
    kept = moving_releases(releases, found.setup.g_px_frame2)
    assert [release.block for release in kept] == ["sphere", "cube", "slab"]


@pytest.mark.parametrize(("frames", "error_px", "name"), [(7, 1.0, "sphere"), (8, 1.0, "cube"), (8, 1e3, "sphere")])
def test_what_is_seen_in_too_few_frames_or_is_rejected_takes_no_name_from_a_release(tmp_path, frames, error_px, name):
    """A hand moves into the picture before the first release."""
    follower = object.__new__(Follower)
    follower.setup, follower.g_px_frame2, follower.chain = stated_setup(tmp_path / "setup.yaml"), 0.0, None
    follower.looks = {"sphere": Looks("outline", outline_of(BLOCKS["sphere"], 6e-4, -1))}
    follower.motion = Motion(candidates=[np.empty(0, CANDIDATE)] * frames)
    follower.releases, follower._named = [], 0
    hand = [Sight(k, np.array([100.0 + 2 * k, 80.0, 0.0]), np.full(3, error_px), 1.0) for k in range(frames)]
    follower.release = FollowedRelease("sphere", hand)
    assert follower._next_block() == name or error_px > 1.0
    follower._end_release()
    assert len(follower.releases) == 1 and follower._next_block() == name


def test_the_names_that_releases_took_are_said_where_they_are_in_doubt(tmp_path):
    setup = stated_setup(tmp_path / "setup.yaml")
    assert remarks_on_names(["sphere", "cube", "slab"], setup) == []
    said = "releases seen and taken for {}, but the key releases of the set-up file lists 3, sphere, cube, slab: "
    for blocks in (["sphere", "slab"], ["cube", "slab", "slab"], ["sphere", "cube", "slab", "slab"]):
        assert said.format(", ".join(blocks)) in remarks_on_names(blocks, setup)[0]
    setup.path.write_text(re.sub(r"releases:\s.*", "releases: [cube]\n", setup.text, flags=re.DOTALL))
    said = remarks_on_names(["cube"] * 5, Setup(setup.path))
    assert said[0].startswith("every release was taken for cube, none for sphere, slab: ")
    assert remarks_on_names(["cube"], Setup(setup.path))[0].startswith("the release was taken for cube, none for ")


def test_background_frames_that_the_film_does_not_have_are_refused(tmp_path):
    setup = stated_setup(tmp_path / "setup.yaml")
    setup.path.write_text(f"{setup.text}detection: {{background_frames: [5, 9]}}\n")
    film = [np.zeros(SIZE_PX[::-1], np.uint8)] * 5
    said = r"setup.yaml:\d+:\d+: detection.background_frames: begins after the last frame: 5 frames"
    refusal(Follower, film, Setup(setup.path), SIZE_PX, Motion(candidates=[np.empty(0, CANDIDATE)] * 5), said=said)


def test_an_arc_too_short_for_a_release_takes_no_name_from_a_release(tmp_path):
    """Looks are learnt on arcs. A hand falls for 6 frames before the first of three releases."""
    follower = object.__new__(Follower)
    follower.setup, follower._chain_blocks = stated_setup(tmp_path / "setup.yaml"), []
    follower.motion = Motion(chains=[chain(10, 15), chain(30, 60), chain(80, 120), chain(140, 160)])
    assert [follower._block_of_chain(frame) for frame in (30, 100, 160)] == ["sphere", "cube", "slab"]


@pytest.mark.parametrize(("shadow", "confidence", "kept"), [(True, 0.8, 0), (True, 0.97, 12), (False, 0.8, 12)])
def test_a_shadow_without_an_arc_is_no_block(shadow, confidence, kept):
    """A hand holds the ball, and its shadow on the wall has the outline of a ball, but no sharp one."""
    follower = object.__new__(Follower)
    outline = outline_of(falls().blocks["sphere"], 1e-3, -1)
    places = [np.array([100.0 + k, 80.0, 0.0]) for k in range(12)]
    darker = [
        np.array([(k, p[:2], 300.0, (-13.0, -13.0, -10.0), True, shadow)][: k % 3], CANDIDATE)
        for k, p in enumerate(places)
    ]
    follower.chain, follower.looks = None, {"sphere": Looks("outline", outline)}
    follower.motion = Motion(candidates=darker)
    sights = [Sight(k, p, np.full(3, 0.5), confidence) for k, p in enumerate(places)]
    release = FollowedRelease("sphere", sights)
    follower._distrust_shadow(release)
    assert len(release.seen) == kept
    assert {s.reason for s in release.sights} == ({"like a shadow"} if not kept else {""})


def test_where_a_release_was_never_seen_any_block_is_another_one():
    """Its frames along an arc were all lost, so that there is no place from which the new one could be far away."""
    follower = object.__new__(Follower)
    follower.release = FollowedRelease("cube", [lost_sight(k, "no fit") for k in range(5)])
    sight = Sight(5, np.array([100.0, 80.0, 0.0]), np.ones(3), 1.0, "")
    assert follower._far_away(sight, outline_of(falls().blocks["cube"], 1e-3, -1))


def test_what_was_seen_gets_the_releases_of_its_size_in_their_order():
    """Releases without arcs do not shift the blocks of the others."""
    stated = [500.0, 500.0, 360.0, 360.0, 800.0]
    assert releases_shown([490.0, 370.0, 790.0], stated) == [0, 2, 4]
    assert releases_shown([350.0, 365.0], stated) == [2, 3]
    assert releases_shown([520.0, 510.0, 340.0, 370.0, 760.0], stated) == [0, 1, 2, 3, 4]
    assert releases_shown([790.0, 350.0], stated) == [0, 2]  # no order has the large one before the small one
    assert releases_shown([], stated) == []
