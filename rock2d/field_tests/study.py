"""The study of a field test: calibrate on one block and predict the others, and cross-validate over folds of all
blocks.

Both impact laws are treated in the same way, and compared with two forecasts without physics. The effect of shape is
that on the distances of a sphere, a cube and a slab of equal mass and volume, with the same soils."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from rock2d.arrays import Array
from rock2d.field_tests.descents import Descents
from rock2d.field_tests.forecasts import Forecast, PartForecast, forecast, joined, naive_forecast
from rock2d.field_tests.likelihood import (
    POSTERIOR_STREAM,
    ROUND_POWERS,
    SimulatedSoils,
    Unknowns,
    drawn_posterior,
    prior_soils,
    refined_soils,
    simulate_soils,
)
from rock2d.files.field_releases import FieldReleases
from rock2d.files.saved_arrays import fingerprint, load_arrays, save_arrays
from rock2d.files.scenario import Scenario
from rock2d.files.scenario_variants import scenario_text
from rock2d.scene.blocks import Block, make_block

OnProgress = Callable[[str, int, int], Any]  # (what, done, total)

FOLDS = 5
REBOUND_PLACES = "model.probabilistic."  # beginning of the places of numbers of the rebound law
FOLD_STREAM, FORECAST_STREAM = 7, 8  # first numbers of spawn keys
FORECAST_SEEDS = 16  # number of different starts, directions and rough grounds of each release in a forecast
FORECAST_NAMES = {"batch": "blocks", "point_mass": "points"}  # engine -> name of its forecasts
SLAB = (2.0, 1.0)  # length and depth of a slab over its height
SHAPE_PERCENTILES = (5.0, 10.0, 50.0, 90.0, 95.0)
SHAPE_STREAM = 9  # first number of a spawn key


def step_counter(on_progress: OnProgress, what: str, of: int) -> Callable[[int], None]:
    """A function that gets the number of further steps done, and calls `on_progress` with their sum."""
    done = 0

    def step(count: int) -> None:
        nonlocal done
        done += count
        on_progress(what, done, of)

    return step


@dataclass(frozen=True)
class Effort:
    """Numbers of simulations.

    Attributes
    ----------
    prior, refined : soils drawn from the prior, and from the posterior in each round
    copies : descents of each release with each soil
    draws : draws of a posterior for a forecast"""

    prior: int = 256
    refined: int = 64
    copies: int = 3
    draws: int = 256


@dataclass(frozen=True)
class Calibration:
    """The calibration of a law on a field test: unknowns and simulated soils."""

    unknowns: Unknowns
    engine: str
    soils: SimulatedSoils
    seed: int
    effort: Effort

    def posterior(self, indices: Array, part: int) -> Array:
        """(draws, d) soils given some of the known releases; `part` numbers the random stream."""
        rng = np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(POSTERIOR_STREAM, part)))
        return drawn_posterior(self.soils, indices, rng, self.effort.draws)

    def forecast(self, releases: FieldReleases, soils: Array, what: str, on_progress: OnProgress) -> Forecast:
        """Forecast of releases, with draws of a posterior."""
        seeds = np.random.SeedSequence(self.seed, spawn_key=(FORECAST_STREAM,)).generate_state(FORECAST_SEEDS)
        scenario = self.unknowns.scenario
        descents = [Descents(scenario, releases, 1, int(own), self.engine) for own in seeds]
        return forecast(self.unknowns, descents, soils, step_counter(on_progress, what, len(soils)))


def unknowns_of(scenario: Scenario, engine: str) -> Unknowns:
    """The unknowns of an engine, without numbers of the other law."""
    of_points = engine == "point_mass"
    places = {
        place: quantiles
        for place, quantiles in scenario.unknown().items()
        if place.startswith("field_test.") or place.startswith(REBOUND_PLACES) == of_points
    }
    return Unknowns(scenario, places)


def calibrate(
    scenario: Scenario, engine: str, seed: int, stages: Path | None, effort: Effort | None, on_progress: OnProgress
) -> Calibration:
    """Simulate all known releases with soils of the prior, then in rounds with soils of the posterior.

    Finished parts are kept in the folder `stages`, if there is one, for later calibrations with the same input and the
    same version of rock2d."""
    assert scenario.terrain is not None
    effort = effort or Effort()
    unknowns, known = unknowns_of(scenario, engine), scenario.terrain.known
    descents = Descents(scenario, known, effort.copies, seed, engine)
    text = f"{scenario_text(scenario)} {engine} {seed} {effort}".encode()
    key = fingerprint(np.frombuffer(text, np.uint8), known.starts_m, known.stops_m, scenario.terrain.terrain.height_m)

    def simulated(u: Array, part: str) -> SimulatedSoils:
        file = None if stages is None else stages / f"{key}_{part.replace(' ', '_')}.npz"
        kept = None if file is None else load_arrays(file)
        if kept is not None:
            return SimulatedSoils(kept["u"], kept["log_density"])
        step = step_counter(on_progress, f"{FORECAST_NAMES[engine]}: {part}", len(u))
        found = simulate_soils(unknowns, descents, u, step)
        if file is not None:
            save_arrays(file, u=found.u, log_density=found.log_density)
        return found

    soils = simulated(prior_soils(unknowns, seed, effort.prior), "prior soils")
    for part in range(len(ROUND_POWERS)):
        likely = refined_soils(soils, seed, part, effort.refined)
        soils = soils.joined(simulated(likely, f"likely soils {part + 1}"))
    return Calibration(unknowns, engine, soils, seed, effort)


def study_forecasts(
    scenario: Scenario, calibration: Calibration, on_progress: OnProgress = lambda *_: None
) -> dict[str, PartForecast]:
    """Forecasts of the other blocks from those of `calibrate_on`, and of all releases, each fold from the others."""
    assert scenario.terrain is not None and scenario.field_test is not None
    known, sources = scenario.terrain.known, scenario.field_test.calibrate_on
    source = known.of_blocks(*sources)
    others, law = np.flatnonzero(~source), FORECAST_NAMES[calibration.engine]
    found = {}
    if len(others):
        name = f"{law}, from {' and '.join(sources)}"
        soils = calibration.posterior(np.flatnonzero(source), 0)
        of_others = calibration.forecast(known.subset(others), soils, name, on_progress)
        found[name] = PartForecast(others, of_others)
    name, parts = f"{law}, held out", []
    for k, fold in enumerate(fold_indices(known, calibration.seed)):
        soils = calibration.posterior(np.setdiff1d(np.arange(len(known)), fold), 1 + k)
        parts.append((fold, calibration.forecast(known.subset(fold), soils, f"{name}, fold {k + 1}", on_progress)))
    return found | {name: PartForecast(np.arange(len(known)), joined(parts, len(known)))}


def naive_forecasts(scenario: Scenario, seed: int) -> dict[str, PartForecast]:
    """Forecasts without physics: other blocks stop like the blocks of `calibrate_on`; a block stops like the other
    releases of the same block."""
    assert scenario.terrain is not None and scenario.field_test is not None
    known, sources = scenario.terrain.known, scenario.field_test.calibrate_on
    source, found = known.of_blocks(*sources), {}
    others = np.flatnonzero(~source)
    if len(others):
        like = naive_forecast(known.distances_m[source], len(others))
        found[f"stops like {' and '.join(sources)}"] = PartForecast(others, like)
    samples = np.full((len(known), len(known)), np.nan)
    sd, caught = np.ones_like(samples), np.zeros_like(samples)
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(FOLD_STREAM, 1)))
    for fold in fold_indices(known, seed):
        for i in fold:
            same = np.setdiff1d(np.flatnonzero(known.of_blocks(known.blocks[i])), fold)
            own = naive_forecast(known.distances_m[same], 1)
            picked = rng.permutation(np.resize(np.arange(len(same)), len(known)))
            samples[i] = own.samples_m[0, picked]
            sd[i], caught[i] = own.discrepancy_m[0, 0], own.caught[0, 0]
    held = PartForecast(np.arange(len(known)), Forecast(samples, sd, caught))
    return found | {"stops like the same block, held out": held}


def fold_indices(known: FieldReleases, seed: int) -> list[Array]:
    """Indices of the releases of each fold, stratified by block."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(FOLD_STREAM,)))
    fold, place = np.empty(len(known), int), 0
    for block in dict.fromkeys(known.blocks):
        shuffled = rng.permutation(np.flatnonzero(known.of_blocks(block)))
        fold[shuffled] = (place + np.arange(len(shuffled))) % FOLDS
        place += len(shuffled)
    return [np.flatnonzero(fold == k) for k in range(FOLDS)]


def posterior_table(calibration: Calibration, soils: Array) -> pd.DataFrame:
    """Draws of a posterior: a column for each place in the scenario file, discrepancy_m, and caught (a share)."""
    table = pd.DataFrame([calibration.unknowns.values(own) for own in soils])
    table["discrepancy_m"] = calibration.unknowns.discrepancy_m(soils)
    table["caught"] = calibration.unknowns.caught(soils)
    return table


def all_soils(calibration: Calibration) -> Array:
    """(draws, d) draws of the posterior given all known releases."""
    return calibration.posterior(np.arange(calibration.soils.log_density.shape[1]), 1 + FOLDS)


def shapes_of(mass_kg: float, density_kg_m3: float) -> dict[str, Block]:
    """A sphere, a cube and a slab (length : height : depth as 2 : 1 : 1) of this mass and density."""
    volume = mass_kg / density_kg_m3
    diameter = (6.0 * volume / np.pi) ** (1.0 / 3.0)
    side = volume ** (1.0 / 3.0)
    height = (volume / (SLAB[0] * SLAB[1])) ** (1.0 / 3.0)
    return {
        "sphere": make_block("sphere", "circle", mass_kg, "solid_sphere", diameter_m=diameter),
        "cube": make_block("cube", "square", mass_kg, side_m=side),
        "slab": make_block("slab", "rectangle", mass_kg, length_m=SLAB[0] * height, height_m=height),
    }


def shape_forecasts(
    unknowns: Unknowns, soils: Array, blocks: dict[str, Block], seed: int, on_progress: Callable[[int], Any]
) -> dict[str, Forecast]:
    """Forecast of each block, released once from every known start with each of these soils."""
    assert unknowns.scenario.terrain is not None
    starts = unknowns.scenario.terrain.known.starts_m
    names = tuple(name for name in blocks for _ in starts)
    places = np.tile(starts, (len(blocks), 1))
    releases = FieldReleases(tuple(map(str, range(len(names)))), names, places, np.full_like(places, np.nan))
    own_seed = int(np.random.SeedSequence(seed, spawn_key=(SHAPE_STREAM,)).generate_state(1)[0])
    descents = Descents(unknowns.scenario, releases, 1, own_seed, other_blocks=blocks)
    found = forecast(unknowns, [descents], soils, on_progress)
    return {name: found.subset(releases.of_blocks(name)) for name in blocks}


def shape_table(found: dict[str, Forecast]) -> pd.DataFrame:
    """Percentiles of the simulated distances of each shape, without discrepancy."""
    rows = [(name, *np.percentile(own.samples_m, SHAPE_PERCENTILES)) for name, own in found.items()]
    return pd.DataFrame(rows, columns=["shape", *(f"q{p:02.0f}_m" for p in SHAPE_PERCENTILES)])
