"""Blind cases whose base is a real record: some of its releases, with known causes put in.

All that the law and the catalogue miss of the real motion stays in the record, and so do the causes that it holds
anyway. The scores of these cases are told apart.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rock2d.blind.cases import FEWEST_CASE_RELEASES, HELDOUT_SHARE, LEAST_STRENGTH
from rock2d.blind.injection import SERIES_EFFECTS, injected, of_releases
from rock2d.diagnosis.detection import SEEN_Z, Curve, detection_curves
from rock2d.diagnosis.diagnose import Diagnosis, diagnose
from rock2d.diagnosis.fitting import Fit
from rock2d.diagnosis.known_causes import (
    effects_of_size,
    largest_size,
    size_parameter,
    values_of_size,
    with_cause,
)
from rock2d.diagnosis.workload import DiagnosisBars
from rock2d.effects import catalogue
from rock2d.errors import InputError
from rock2d.files.experiment import Experiment, load_experiment, write_experiment
from rock2d.files.folders import make_folder
from rock2d.scene.world import World

SHARE_OF_RECORDS = 1.0 / 3.0  # share of all cases whose base is a record, if that many can have one


@dataclass(frozen=True)
class Record:
    """A real record as base of cases.

    Attributes
    ----------
    fit : the fit that the diagnosis of the record as it is settles on
    named : effects that it holds anyway
    curves : effect -> the sizes that the whole record shows; without effects that it cannot show
    """

    experiment: Experiment
    setup: World
    fit: Fit
    named: list[str]
    curves: dict[str, Curve]


def diagnosed_film(
    experiment: Experiment, folder: Path, workers: int, progress: bool, fits: Path | None = None
) -> Diagnosis:
    """The diagnosis of the film in a folder, into which causes can be put; `fits` keeps finished fits. Raises
    InputError if it is no film, or cannot be diagnosed."""
    if experiment.trajectories is None:
        message = "a cause can be put into a film, not into a table of impacts"
        raise InputError(message, folder, code="wrong_kind")
    if fits is not None:
        make_folder(fits)
    bars = DiagnosisBars(progress, len(catalogue()), workers)
    result = diagnose(experiment, workers=workers, folder=fits, bars=bars)
    if result.found is None:
        message = "the film cannot be diagnosed; rock2d diagnose says why"
        raise InputError(message, folder, code="not_diagnosed")
    return result


def read_record(folder: Path, workers: int, progress: bool) -> Record:
    """Diagnose a film, so that it can be the base of cases. Raises InputError if it cannot be diagnosed, or has too few
    releases to divide."""
    result = diagnosed_film(load_experiment(folder), folder, workers, progress)
    table, found = result.experiment.trajectories, result.found
    assert table is not None and found is not None
    fewest = math.ceil((1.0 + HELDOUT_SHARE) * FEWEST_CASE_RELEASES)
    if table["release"].nunique() < fewest:
        raise InputError(f"expected at least {fewest} releases", folder, code="bad_value")
    effects = {name: catalogue()[name] for name in effects_of_size("")}
    curves = detection_curves(result, effects)
    return Record(result.experiment, result.setup, found.settled, sorted(found.named), curves)


def bases_of(
    causes: Sequence[tuple[str, ...]], records: int, seed: np.random.SeedSequence
) -> list[int | None]:
    """For each case the number of the record that is its base; None for one that is made. A case with a cause that
    has no size, or from outside the catalogue, or that grows from release to release, is made."""
    rng, possible = np.random.default_rng(seed), set(effects_of_size("")) - set(SERIES_EFFECTS)
    eligible = [i for i, own in enumerate(causes) if possible.issuperset(own)]
    count = round(SHARE_OF_RECORDS * len(causes)) if records else 0
    number = {int(i): k % records for k, i in enumerate(rng.permutation(eligible)[:count])}
    return [number.get(i) for i in range(len(causes))]


def write_record_case(
    record: Record, causes: Sequence[str], seed: np.random.SeedSequence, fit: Path, heldout: Path
) -> dict[str, Any]:
    """Write two films of different releases of a record, with the same causes; returns the label.

    The signal-to-noise ratio of a cause is that of its gain as a linear model expects it. Its size at an even chance
    to be seen has `SEEN_Z`, and the ratio grows with the root of the number of releases.
    """
    rng = np.random.default_rng(seed)
    whole = record.experiment
    assert whole.trajectories is not None
    names = np.unique(whole.trajectories["release"])
    most = int(len(names) / (1.0 + HELDOUT_SHARE))
    count = round(math.exp(rng.uniform(math.log(FEWEST_CASE_RELEASES), math.log(most))))
    chosen = rng.permutation(names)[: count + math.ceil(HELDOUT_SHARE * count)]
    films = [of_releases(whole, own) for own in (chosen[:count], chosen[count:])]
    model, p = record.fit.model, record.fit.p
    hidden, strengths = list[dict[str, Any]](), list[float]()
    for name in causes:
        effect = catalogue()[name]
        parameter = size_parameter(effect, record.setup)
        assert parameter is not None
        size = largest_size(parameter) * math.exp(rng.uniform(math.log(LEAST_STRENGTH), 0.0))
        values = values_of_size(effect, size, record.setup, below=bool(rng.random() < 0.5))
        films = [
            injected(own, model, p, effect, values, int(rng.integers(2**31))).experiment for own in films
        ]
        model, _, p = with_cause(model, p, effect, values)
        shown = size / record.curves[name].seen50 if name in record.curves else 0.0
        strengths.append(SEEN_Z * shown * math.sqrt(count / len(names)))
        hidden.append({"name": name, "form": 0, "values": values, "signal_to_noise": strengths[-1]})
    for folder, film in zip((fit, heldout), films, strict=True):
        folder.mkdir(parents=True, exist_ok=True)  # a worker that died may have begun
        write_experiment(folder, film)
    blocks = record.setup.blocks
    return {
        "label": "+".join(sorted(causes)) or "none",
        "base": whole.name,
        "of_record": record.named,
        "hidden": hidden,
        "signal_to_noise": math.hypot(*strengths),
        "kind": "record",
        "blocks": list(blocks),
        "releases": count,
        "fps": films[0].fps,
        "block_size_m": record.setup.mean_size_m,
        "position_noise_m": whole.position_noise_m,
        "angle_noise_rad": whole.angle_noise_rad,
    }
