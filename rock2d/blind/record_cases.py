"""Blind cases based on a real record: some of its releases, with known causes added.

What the law and the catalogue miss of the real motion remains in the record, as do the causes that it already contains.
The scores of these cases are reported separately."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rock2d.blind.cases import FEWEST_CASE_RELEASES, LEAST_STRENGTH
from rock2d.blind.injection import injected
from rock2d.diagnosis.detection import SEEN_Z, Curve, detection_curves
from rock2d.diagnosis.diagnose import Diagnosis, diagnose
from rock2d.diagnosis.fitting import Fit
from rock2d.diagnosis.known_causes import effects_of_size, largest_size, size_parameter, values_of_size, with_cause
from rock2d.diagnosis.workload import DiagnosisBars
from rock2d.effects import catalogue
from rock2d.errors import InputError
from rock2d.files.experiment import Experiment, load_experiment, write_experiment
from rock2d.files.folders import make_folder
from rock2d.scene.world import World

SHARE_OF_RECORDS = 1.0 / 3.0  # share of the cases that are based on a record, if as many can be
RECORD_HELDOUT_SHARE = 0.4  # held-out releases over those of the fit: a record has few


@dataclass(frozen=True)
class Record:
    """A real record on which cases are based.

    Attributes
    ----------
    fit : final fit of the diagnosis of the original record
    named : effects that the original record contains
    curves : effect -> detection curve of the whole record; without effects that it cannot show"""

    experiment: Experiment
    setup: World
    fit: Fit
    named: list[str]
    curves: dict[str, Curve]


def diagnosed_film(
    experiment: Experiment, folder: Path, workers: int, progress: bool, fits: Path | None = None
) -> Diagnosis:
    """The diagnosis of the film in a folder, to which causes can be added; `fits` keeps finished fits. Raises
    InputError if it is not a film, or cannot be diagnosed."""
    if experiment.trajectories is None:
        message = "a cause can be added to a film, not to a table of impacts"
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
    """Diagnose a film on which cases will be based. Raises InputError if it cannot be diagnosed, or has too few
    releases to divide."""
    result = diagnosed_film(load_experiment(folder), folder, workers, progress)
    table, attribution = result.experiment.trajectories, result.found
    assert table is not None and attribution is not None
    fewest = math.ceil((1.0 + RECORD_HELDOUT_SHARE) * FEWEST_CASE_RELEASES)
    if table["release"].nunique() < fewest:
        raise InputError(f"expected at least {fewest} releases", folder, code="bad_value")
    curves = detection_curves(result, effects_of_size(""))
    return Record(result.experiment, result.setup, attribution.settled, sorted(attribution.named), curves)


def records_of_cases(causes: Sequence[tuple[str, ...]], records: int, seed: np.random.SeedSequence) -> list[int | None]:
    """For each case the number of the record on which it is based; None for a made case. A case is made if one of its
    causes has no size, is outside the catalogue, or grows from release to release."""
    rng, possible = np.random.default_rng(seed), {n for n in effects_of_size("") if not catalogue()[n].grows}
    eligible = [i for i, case_causes in enumerate(causes) if possible.issuperset(case_causes)]
    count = round(SHARE_OF_RECORDS * len(causes)) if records else 0
    number = {int(i): k % records for k, i in enumerate(rng.permutation(eligible)[:count])}
    return [number.get(i) for i in range(len(causes))]


def write_record_case(
    record: Record, causes: Sequence[str], seed: np.random.SeedSequence, fit: Path, heldout: Path
) -> dict[str, Any]:
    """Write two films of different releases of a record, with the same causes; returns the label.

    The signal-to-noise ratio of a cause is that of its gain in a linear model. A size that is named with probability
    0.5 has the ratio `SEEN_Z`, and the ratio grows with the root of the number of releases."""
    rng = np.random.default_rng(seed)
    original = record.experiment
    table = original.trajectories
    assert table is not None
    names = np.unique(table["release"])
    most = int(len(names) / (1.0 + RECORD_HELDOUT_SHARE))
    count = round(math.exp(rng.uniform(math.log(FEWEST_CASE_RELEASES), math.log(most))))
    chosen = rng.permutation(names)[: count + math.ceil(RECORD_HELDOUT_SHARE * count)]
    films = [
        replace(original, trajectories=table[table["release"].isin(own)]) for own in (chosen[:count], chosen[count:])
    ]
    model, p = record.fit.model, record.fit.p
    hidden, strengths = list[dict[str, Any]](), list[float]()
    for name in causes:
        effect = catalogue()[name]
        size = largest_size(size_parameter(effect, record.setup)) * math.exp(rng.uniform(math.log(LEAST_STRENGTH), 0.0))
        values = values_of_size(effect, size, record.setup, below=bool(rng.random() < 0.5))
        films = [injected(own, model, p, effect, values, int(rng.integers(2**31))).experiment for own in films]
        model, _, p = with_cause(model, p, effect, values)
        shown = size / record.curves[name].seen50 if name in record.curves else 0.0
        strengths.append(SEEN_Z * shown * math.sqrt(count / len(names)))
        hidden.append({"name": name, "form": 0, "values": values, "signal_to_noise": strengths[-1]})
    for folder, film in zip((fit, heldout), films, strict=True):
        folder.mkdir(parents=True, exist_ok=True)  # a worker that died may have made it
        write_experiment(folder, film)
    blocks = record.setup.blocks
    return {
        "label": "+".join(sorted(causes)) or "none",
        "base": original.name,
        "of_record": record.named,
        "hidden": hidden,
        "signal_to_noise": math.hypot(*strengths),
        "kind": "record",
        "blocks": list(blocks),
        "releases": count,
        "fps": films[0].fps,
        "block_size_m": record.setup.mean_size_m,
        "position_noise_m": original.position_noise_m,
        "angle_noise_rad": original.angle_noise_rad,
    }
