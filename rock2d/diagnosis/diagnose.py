"""A whole diagnosis: from an experiment to the content of diagnosis.json."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from rock2d.diagnosis.attribution import Attribution, attribute
from rock2d.diagnosis.base_law import fit_base, register_by_fit
from rock2d.diagnosis.budget import Budget, Share
from rock2d.diagnosis.checks import Checks
from rock2d.diagnosis.data import FilmData, TableData
from rock2d.diagnosis.fitting import fit, some_releases
from rock2d.diagnosis.gap import Cell, budget_and_shares, find_rests, locate_gap
from rock2d.diagnosis.predicted_gap import PredictedGap, predicted_gap
from rock2d.diagnosis.visibility import unseen
from rock2d.diagnosis.workload import GAP, READING, DiagnosisBars
from rock2d.effects import catalogue
from rock2d.effects.effect import Effect
from rock2d.files.experiment import Experiment
from rock2d.files.saved_arrays import fingerprint
from rock2d.kinematics import sanity as fault_codes
from rock2d.kinematics.film_findings import (
    FilmFindings,
    film_findings,
    flightless_remarks,
    rest_remarks,
    shape_remarks,
    slow_error_remarks,
)
from rock2d.kinematics.film_segments import FilmSegments
from rock2d.kinematics.flights import Film, load_film
from rock2d.kinematics.sanity import Sanity, check_film, check_impacts, check_table
from rock2d.kinematics.setup_world import base_law_start, setup_world
from rock2d.records.columns import POSITION, THETA
from rock2d.scene.world import World

FAINTEST_NOISE = 5.0e-5  # in block sizes and rad; less noise counts as none
CAMERA_NOISE = 2.0e-2  # in the same units
NOISE_SEED = 1
# faults of films whose flights can still be read
FAULTS_THAT_LEAVE_FLIGHTS = {
    fault_codes.FEW_RELEASES, fault_codes.FEW_IMPACTS, fault_codes.WRONG_GRAVITY, fault_codes.CONSTANT_ANGLE,
    fault_codes.BELOW_GROUND, fault_codes.ABOVE_GROUND, fault_codes.BESIDE_GROUND,
}  # fmt: skip


@dataclass(repr=False)
class Diagnosis:
    """Result of a diagnosis. If the experiment could not be diagnosed, `data` and the later fields are None.

    Attributes
    ----------
    film : what the film says of itself; None for an impact table and a film that cannot be read
    data : flights and impacts
    found : the attribution
    shares : effect -> share of the gap that it closes alone
    predicted : errors of predictions of whole segments; None without impacts of a film
    cells : where the gap lies
    unseen : effects that these data cannot show -> reason
    seed : seed of the bootstrap"""

    experiment: Experiment
    sanity: Sanity
    setup: World
    film: FilmFindings | None = None
    data: FilmData | TableData | None = None
    found: Attribution | None = None
    shares: dict[str, Share] | None = None
    budget: Budget | None = None
    predicted: PredictedGap | None = None
    cells: list[Cell] | None = None
    unseen: dict[str, str] | None = None
    seed: int | None = None

    def __repr__(self) -> str:
        return f"<Diagnosis of {self.experiment.name}: {self.verdict}>"

    @property
    def verdict(self) -> str:
        return self.found.verdict if self.found is not None else "unknown"

    @property
    def checks(self) -> Checks | None:
        """Whether the model with the learnt changes would have made these data."""
        return self.found.checks if self.found is not None else None


def diagnose(
    experiment: Experiment,
    *,
    seed: int = 0,
    effects: Mapping[str, Effect] | None = None,
    workers: int = 1,
    folder: Path | None = None,
    bars: DiagnosisBars | None = None,
) -> Diagnosis:
    """Diagnose an experiment.

    Parameters
    ----------
    seed : of the bootstrap and of the replicates of the checks
    effects : effects to try; default: the whole catalogue
    workers : number of processes that fit effects; the result does not depend on it
    folder : for finished fits, so that an interrupted diagnosis can continue
    bars : progress bars"""
    tried = effects or catalogue()
    bars = bars or DiagnosisBars(False, len(tried), workers)
    setup = setup_world(experiment)
    with bars.stage(READING, 1, "steps") as bar:
        bars.starts()
        sanity, data = check_and_segment(experiment, setup)
        bar.step("flights and impacts")
    result = Diagnosis(experiment, sanity, setup)
    if data is None:
        result.film = findings_of_film(experiment, setup, sanity, data)
        return result
    if folder is not None:
        stated = np.array([[b.mass_kg, b.inertia_kg_m2, b.size_m] for b in experiment.blocks.values()])
        if isinstance(data, TableData):
            keys = [data.before, data.after, data.impact_release]
        else:
            keys = [data.film.t_s, data.film.pose, data.film.release]
        keys += [experiment.cross_section.points_m, experiment.cross_section.zone_ids, stated]
        folder = folder / fingerprint(*keys, np.array([experiment.gravity_m_s2, experiment.fps]))
        folder.mkdir(parents=True, exist_ok=True)
    bars.read(float(some_releases(data).mean()))
    # the matrices of the fits are small: several threads of linear algebra slow each other down
    with threadpool_limits(1):
        base, refitted = fit_base(setup, base_law_start(experiment), data, sanity.registered, bars), None
        if isinstance(data, FilmData) and len(data.impacts) and base.free:
            registered = register_by_fit(base, data)
            if registered is not None:
                data, sanity.registered = registered
                sanity.remarks.append(registered_remark(setup, sanity.registered))
                base = fit_base(setup, base_law_start(experiment), data, sanity.registered)
                # the stated ground is nearly right: blocks do not fall into it
                refitted = fit(base.model, data, base.p, old=base, renew_noise=True)
        result.film = findings_of_film(experiment, setup, sanity, data)
        if isinstance(data, FilmData):  # in the image that fits, as the findings
            sanity.remarks += rest_remarks(data, _over_stated_ground(sanity, setup)) + slow_error_remarks(data)
        unseen_effects = unseen(base, data, tried, result.film)
        visible = {name: effect for name, effect in tried.items() if name not in unseen_effects}
        attribution = attribute(
            base, data, visible, refitted=refitted, workers=workers, folder=folder, bars=bars, seed=seed
        )
    result.data, result.found, result.unseen, result.seed = data, attribution, unseen_effects, seed
    with bars.stage(GAP, 3, "steps") as bar:
        result.budget, result.shares = budget_and_shares(data, attribution, seed)
        bar.step("budget")
        result.cells = locate_gap(experiment, data, attribution)
        bar.step("places")
        if isinstance(data, FilmData) and len(data.impacts):
            result.predicted = predicted_gap(data, attribution.base, attribution.learnt, seed)
        bar.step("predictions")
    return result


def registered_remark(setup: World, world: World) -> str:
    """A remark on the world in which a film is segmented, if it differs from the stated one."""
    moved_m = float(np.hypot(*(world.cross_section.points_m - setup.cross_section.points_m).T).max())
    if moved_m:
        return (
            f"flights and impacts fit ground that lies up to {1e3 * moved_m:.2g} mm beside the stated one; the film is "
            "divided into flights over it"
        )
    turn = f"{np.rad2deg(world.view.tilt_rad):.2g}".replace("-", "−")
    return (
        f"flights and impacts fit an image that is turned by {turn}° and "
        f"{world.view.scale:.4f} times as large as stated; the film is divided into flights in it"
    )


def check_and_segment(experiment: Experiment, setup: World) -> tuple[Sanity, FilmData | TableData | None]:
    """Result of the sanity checks, and flights and impacts; None for the latter if there is a fault."""
    data: FilmData | TableData
    if experiment.trajectories is not None:
        sanity, segments = _check_and_segment_film(experiment, setup)
        noisy, remarks = with_camera_noise(experiment, segments.film) if segments is not None else (experiment, [])
        if remarks:
            sanity, segments = _check_and_segment_film(noisy, setup)
            sanity.remarks += remarks
        if segments is None:
            return sanity, None
        data, world = segments, sanity.registered or setup
        sanity.remarks += [*shape_remarks(data, world), *flightless_remarks(data)]
    else:
        data = TableData.of(experiment)
        sanity = check_table(experiment, data)
    if not sanity.faults:
        impacts, flying = len(data.impact_release), len(np.unique(data.flight_release[: data.flown]))
        resting, blocks_with_edges = 0, list[str]()
        if isinstance(data, FilmData):
            resting = len(find_rests(data).flight)
            blocks_with_edges = [name for name in data.film.blocks_without_angle if not setup.blocks[name].smooth]
        judgeable = check_impacts(impacts, impacts + resting, flying, blocks_with_edges, sanity)
        if isinstance(data, FilmData) and not judgeable:
            data = data.flights_alone()
    return sanity, None if sanity.faults else data


def _check_and_segment_film(experiment: Experiment, setup: World) -> tuple[Sanity, FilmData | None]:
    """Result of the sanity checks of a film, and its flights and impacts; None for the latter if there is a fault."""
    film = load_film(experiment)
    sanity = check_film(experiment, film)
    return sanity, None if sanity.faults else FilmData.of(film, sanity.registered or setup)


def with_camera_noise(experiment: Experiment, film: Film) -> tuple[Experiment, list[str]]:
    """Add noise to positions or angles that have none in the segmented `film`, as written by a simulation.

    Returns the experiment and remarks; the same experiment and none if both have noise. An angle that was not measured,
    as for a circle without marks, stays constant.

    A diagnosis compares all residuals with noise, and no simulation is exact: the steps of the law change the velocity
    after an impact by up to 0.002 √(g × radius) and the spin by 0.005 √(g / radius) (99 % of the impacts, steps of 0.2
    rad against 0.0125 rad). Without noise such errors would count as causes. `CAMERA_NOISE` hides them."""
    assert experiment.trajectories is not None
    size = min(block.size_m for block in experiment.blocks.values())
    noisy_channels = film.measured & (film.noise > FAINTEST_NOISE * np.array([size, size, 1.0]))
    added, additions = np.zeros(3), []
    if not noisy_channels[POSITION].any():
        added[POSITION] = CAMERA_NOISE * size
        additions.append(f"{CAMERA_NOISE * size:.2g} m in positions")
    if not noisy_channels[THETA] and film.angle_known.any():
        added[THETA] = CAMERA_NOISE
        additions.append(f"{CAMERA_NOISE:.2g} rad in angles")
    if not additions:
        return experiment, []
    table = experiment.trajectories.copy()
    noise = np.random.default_rng(NOISE_SEED).normal(size=(len(table), 3)) * added
    noise[~table["release"].isin(film.release_names[film.angle_known]), THETA] = 0.0
    table[["x_m", "y_m", "theta_rad"]] += noise
    noisy = replace(
        experiment, trajectories=table, position_noise_m=max(experiment.position_noise_m, added[0]),
        angle_noise_rad=max(experiment.angle_noise_rad, added[THETA]),
    )  # fmt: skip
    return noisy, [
        f"The film shows no noise, like the output of a simulation, and no simulation is exact. It was diagnosed with "
        f"added camera noise, 1 sigma: {' and '.join(additions)}. For another noise, set outputs.position_noise_m and "
        "outputs.angle_noise_rad in the scenario and simulate again"
    ]


def findings_of_film(
    experiment: Experiment, setup: World, sanity: Sanity, data: FilmData | TableData | None
) -> FilmFindings | None:
    """What a film says of itself, even if it is too poor to diagnose; None for an impact table and an unreadable
    film."""
    if experiment.trajectories is None or any(fault.code not in FAULTS_THAT_LEAVE_FLIGHTS for fault in sanity.faults):
        return None
    if setup.gravity_m_s2 <= 0:
        return None
    world = sanity.registered or setup
    segments = data if isinstance(data, FilmData) else FilmSegments.of(load_film(experiment), world)
    return film_findings(segments, _over_stated_ground(sanity, setup), experiment.fps, experiment.from_gravity)


def _over_stated_ground(sanity: Sanity, setup: World) -> World:
    """The world with the image in which the film is segmented, and with the stated ground: what blocks at rest show of
    it."""
    return replace(sanity.registered or setup, cross_section=setup.cross_section)
