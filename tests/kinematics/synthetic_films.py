"""Films of a known world, made with the batch engine: what a diagnosis must find in them is known."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from rock2d.diagnosis import exploring, fitting, residual_regression
from rock2d.diagnosis.data import FilmData
from rock2d.diagnosis.fitting import Fit, fit
from rock2d.diagnosis.model import Model
from rock2d.effects import catalogue
from rock2d.effects.effect import Effect
from rock2d.engines.batch import run_batch, world_ensemble
from rock2d.files.experiment import Experiment
from rock2d.kinematics.flights import load_film
from rock2d.kinematics.setup_world import setup_world
from rock2d.kinematics.states import centroid_poses
from rock2d.laws.contact import ContactParameters, contact_table
from rock2d.scene.cross_section import CrossSection
from rock2d.scene.world import World
from tests.laboratory import CUBE, SPHERE

POINTS = [[-0.6, 0.5], [0.0, 0.0], [0.14, 0.0], [0.18, 0.083], [0.235, 0.083], [0.36, 0.0], [0.9, 0.0]]
ZONES = ["slope", "ditch", "uphill_face", "crest", "downhill_face", "run_out"]
SOIL = {"k_l_N_m": 1.1e4, "k_ul_N_m": 7e4, "k_t_N_m": 3e3, "friction_angle_deg": 32.0, "k_r_Nm_rad": 0.03}
LAW = ContactParameters(**SOIL)
START = np.array([1e4, 6.0, 2.5e3, np.tan(np.pi / 6), 0.025])  # of a fit that does not know this law
BLOCKS = {"sphere": SPHERE, "cube": CUBE}


def world(order: np.ndarray | None = None, law: ContactParameters = LAW) -> World:
    """A set-up like the paper's, with the base law."""
    cross_section = CrossSection(POINTS, ZONES)
    table = contact_table(law, cross_section.zone_names)[None]
    return World(BLOCKS, cross_section, table, order=np.zeros(1) if order is None else order)


def yielded(true: World, shift_m: float) -> World:
    """A world whose embankment has been pushed downhill."""
    points, own = true.cross_section.points_m.copy(), true.cross_section.embankment
    points[own.left : own.right + 1, 0] += shift_m
    return replace(true, cross_section=CrossSection(points, ZONES))


def film_table(blocks: Sequence[str], t_s: np.ndarray, pose: np.ndarray) -> pd.DataFrame:
    """The trajectories of releases, from their blocks (n,), instants (n, k) and poses (n, k, 3)."""
    n, k = t_s.shape
    names = ("x_m", "y_m", "theta_rad")
    columns = dict(zip(names, pose.reshape(-1, 3).T, strict=True))
    return pd.DataFrame(
        {"release": np.repeat(np.arange(n), k), "block": np.repeat(blocks, k), "t_s": t_s.ravel(), **columns}
    )


def film(
    true: World, releases: int = 16, *, seed: int = 0, fps: float = 1000.0, duration_s: float = 0.4,
    noise_m: float = 3e-4, noise_rad: float = 0.02, soil: float = 0.03,
) -> Experiment:  # fmt: skip
    """`releases` of each block filmed in a true world whose soil varies by `soil` from release to release.

    The experiment that comes back states the set-up without effects."""
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    n = releases * len(BLOCKS)
    block = np.repeat(np.arange(len(BLOCKS)), releases)
    states = np.column_stack([
        rng.normal(0.005, 0.014, n), rng.normal(0.10, 0.008, n), rng.uniform(-3, 3, n),
        rng.normal(1.2, 0.2, n), rng.normal(-1.8, 0.15, n), rng.normal(-40, 15, n),
    ])  # fmt: skip
    rows = np.repeat(true.contact, n, axis=0) if len(true.contact) == 1 else true.contact.copy()
    rows[..., :2] *= np.exp(rng.normal(0.0, soil, (n, 1, 1)))
    t = np.arange(round(duration_s * fps)) / fps
    ensemble, _ = world_ensemble(World(**{**vars(true), "contact": rows}))
    result = run_batch(
        ensemble, states, block_ids=block, table_ids=np.arange(n), time_limit_s=duration_s,
        times_s=t * true.view.time_scale,
    )  # fmt: skip
    pose = true.view.record(centroid_poses(true, block, result.samples))
    pose += rng.normal(size=pose.shape) * [noise_m, noise_m, noise_rad]
    table = film_table(np.array(list(BLOCKS))[block], np.tile(t, (n, 1)), pose)
    ground = CrossSection(POINTS, ZONES)
    return Experiment("synthetic", 9.81, fps, noise_m, noise_rad, ground, dict(BLOCKS), trajectories=table)


def without_angles(experiment: Experiment, *blocks: str, instead: float = np.nan) -> Experiment:
    """The film of blocks that have no marks: this value stands for their angles."""
    table = experiment.trajectories
    angles = table["theta_rad"].mask(table["block"].isin(blocks), instead)
    return replace(experiment, trajectories=table.assign(theta_rad=angles))


def data_of(experiment: Experiment) -> tuple[World, FilmData]:
    """The stated world of a film, and the film as a diagnosis reads it."""
    setup = setup_world(experiment)
    return setup, FilmData.of(load_film(experiment), setup)


def base_fit(experiment: Experiment, start: np.ndarray = START) -> tuple[FilmData, Fit]:
    """A film as a diagnosis reads it, and the base law fitted to it."""
    setup, data = data_of(experiment)
    return data, fit(Model(setup, start), data)


@contextmanager
def coarse_fits() -> Iterator[None]:
    """Diagnoses look at few values, do not fit the scatter of the soil and grow few trees, where no statement asks how
    well they fit."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fitting, "fit_scatter", lambda residuals, slope, start: start)
        patch.setattr(exploring, "SCAN_VALUES", 3)
        patch.setattr(exploring, "MOST_RESCANS", 0)
        patch.setattr(residual_regression, "TREES", 5)
        yield


def effects(*names: str) -> dict[str, Effect]:
    """These effects of the catalogue."""
    return {name: catalogue()[name] for name in names}


def with_causes(true: World, causes: Mapping[str, Sequence[float]]) -> World:
    """A world with effects at these values."""
    for name, values in causes.items():
        true = catalogue()[name].apply(true, values)
    return true


def series_order(releases: int) -> np.ndarray:
    """Place of each release of `film` in its block's series."""
    return np.tile(np.arange(releases, dtype=float), len(BLOCKS))
