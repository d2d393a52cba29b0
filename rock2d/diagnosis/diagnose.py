"""A whole diagnosis: from an experiment to the content of diagnosis.json."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from rock2d.diagnosis.attribution import Attribution, attribute, fit_base
from rock2d.diagnosis.budget import GAP_UNIT, Budget, Share
from rock2d.diagnosis.film_data import FilmData
from rock2d.diagnosis.fitting import Fit
from rock2d.diagnosis.gap import (
    FLIGHT_CHANNELS,
    Cell,
    Gap,
    Gaps,
    Part,
    flight_part,
    impact_part,
    where,
)
from rock2d.diagnosis.impact_table_data import TableData
from rock2d.diagnosis.inclusion import inclusion, outside
from rock2d.diagnosis.model import BASE_NAMES, BASE_WIDTH, Model, is_factor
from rock2d.diagnosis.next_release import next_release
from rock2d.diagnosis.rest_prediction import find_rests, rest_squares, rest_variance
from rock2d.effects import catalogue
from rock2d.effects.effect import Effect
from rock2d.files.experiment import Experiment
from rock2d.files.saved_arrays import fingerprint
from rock2d.kinematics.flights import load_film
from rock2d.kinematics.rest_heights import rest_remarks
from rock2d.kinematics.sanity import Sanity, check_film, check_impacts, check_table
from rock2d.kinematics.setup_world import base_start, setup_world
from rock2d.kinematics.stated_shapes import shape_remarks
from rock2d.laws.contact import INDENTATION
from rock2d.records.columns import X
from rock2d.scene.cross_section import CrossSection
from rock2d.scene.world import World

Array = np.ndarray

LEAST_LISTED_PROBABILITY = 0.05  # of an effect among the causes
UNKNOWN_IF_FAULTY = 0.5  # probability of "unknown" for an experiment that could not be diagnosed
BASE_EVALUATIONS, EFFECT_EVALUATIONS = (
    400,
    220,
)  # at all impacts, that fits of the base and of an effect take on average


@dataclass
class Diagnosis:
    """Everything found about an experiment. From `data` to `cells`, fields are None if it could not be diagnosed.

    `gaps` is what each effect closes alone; `regression_closes` the share that a flexible regression closes without any
    effect; `seed` that of the bootstrap, None if nothing was drawn.
    """

    experiment: Experiment
    sanity: Sanity
    setup: World
    data: FilmData | TableData | None = None
    found: Attribution | None = None
    gaps: dict[str, Gap] | None = None
    budget: Budget | None = None
    regression_closes: float = 0.0
    cells: list[Cell] | None = None
    seed: int | None = None

    @property
    def verdict(self) -> str:
        return self.found.verdict if self.found is not None else "unknown"


def diagnose(
    experiment: Experiment,
    *,
    seed: int = 0,
    effects: Mapping[str, Effect] | None = None,
    workers: int = 1,
    folder: Path | None = None,
    on_progress: Callable[[str], None] = lambda name: None,
    on_forecast: Callable[[float], None] = lambda seconds: None,
) -> Diagnosis:
    """Diagnose an experiment.

    Parameters
    ----------
    seed : of the bootstrap
    effects : to try; default the whole catalogue
    workers : number of processes that fit effects; the result does not depend on it
    folder : for finished fits, so that an interrupted diagnosis can continue
    on_progress : called with the name of each model when it is done
    on_forecast : called at the start with a rough number of seconds that the diagnosis will take
    """
    setup = setup_world(experiment)
    sanity, data = prepared(experiment, setup)
    result = Diagnosis(experiment, sanity, setup)
    if data is None:
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
    # the matrices of the fits are small: several threads of linear algebra slow each other down
    with threadpool_limits(1):
        tried = effects or catalogue()
        on_forecast(_duration_s(setup, base_start(experiment), data, len(tried), workers))
        base = fit_base(setup, base_start(experiment), data, result.sanity.registered)
        on_progress("base")
        found = attribute(base, data, tried, workers=workers, folder=folder, on_progress=on_progress)
    result.data, result.found, result.seed = data, found, seed
    gaps = Gaps(data, found, seed)
    result.gaps = {name: gaps.of(candidate) for name, candidate in found.candidates.items()}
    result.budget, result.regression_closes = gaps.budget, gaps.by_regression()
    result.cells = locate(experiment, data, found, setup)
    return result


def prepared(experiment: Experiment, setup: World) -> tuple[Sanity, FilmData | TableData | None]:
    """What the sanity checks found, and flights and impacts; None instead of these if there is a fault."""
    data: FilmData | TableData
    if experiment.trajectories is not None:
        film = load_film(experiment)
        sanity = check_film(experiment, film)
        if sanity.faults:
            return sanity, None
        world = sanity.registered or setup
        data = FilmData.of(film, world)
        sanity.remarks += shape_remarks(data, world) + rest_remarks(film, world)
    else:
        data = TableData.of(experiment)
        sanity = check_table(experiment, data)
    if not sanity.faults:
        impacts = len(data.impact_release)
        stay = len(find_rests(data).flight) if isinstance(data, FilmData) else 0
        check_impacts(impacts, impacts + stay, sanity)
    return sanity, None if sanity.faults else data


def _duration_s(setup: World, start: Array, data: FilmData | TableData, effects: int, workers: int) -> float:
    """Expected seconds of all fits, from the time of one evaluation of all residuals."""
    model = Model(setup, start)
    model.residuals(model.start(), data)  # the first evaluation may compile
    begin = perf_counter()
    model.residuals(model.start(), data)
    return (perf_counter() - begin) * (BASE_EVALUATIONS + EFFECT_EVALUATIONS * effects / workers)


def locate(
    experiment: Experiment, data: FilmData | TableData, found: Attribution, setup: World
) -> list[Cell]:
    """Where the gap lies. A flight belongs to the zone below its middle, a rest to the zone below its end."""
    cross_section, blocks = experiment.cross_section, list(experiment.blocks)
    bare = None
    if found.verdict == found.best and not found.chain[0].effect.camera:
        # The parameters of the base have adapted to the effect everywhere, and air forces change impacts, too. The law
        # found with the effect, in the air found with it, shows where the ground is wrong.
        model, p = found.final.fit.model, found.final.fit.p
        law = found.base.model.world(p[: len(BASE_WIDTH)], data.impact_order)
        for effect, values in zip(model.effects, model.values(p), strict=True):
            law = effect.apply(law, values) if effect.phase == "flight" else law
        bare = data.residuals(law).impacts
    parts = [impact_part(found, data.impact_zone, data.impact_block, data.impact_release, bare)]
    if isinstance(data, FilmData):
        flights = data.segmentation.flights
        best = found.final.fit
        fitted = best.model.world(
            best.p, data.impact_order
        )  # the stated set-up would put a mirrored film on the wrong side
        below = _zone_below(cross_section, data.states(fitted).middle[:, X])
        parts.append(flight_part(found, below, flights.block, flights.release))
        rests = find_rests(data)
        if len(rests.flight):
            variance = rest_variance(data, rests, best)
            before, after = (rest_squares(data, rests, fit, variance) for fit in (found.base, best))
            own = _zone_below(cross_section, rests.pose[:, X])
            columns = ([0], [1], [2])
            parts.append(
                Part(
                    "rest",
                    before - after,
                    before,
                    after,
                    own,
                    flights.block[rests.flight],
                    flights.release[rests.flight],
                    FLIGHT_CHANNELS,
                    columns,
                )
            )
    return where(parts, cross_section.zone_names, blocks)


def _zone_below(cross_section: CrossSection, x: Array) -> Array:
    """(n,) zone of the ground below positions x."""
    facet = np.searchsorted(cross_section.points_m[1:, X], x)
    return cross_section.zone_ids[np.clip(facet, 0, len(cross_section.zones) - 1)]


def effect_values(fit: Fit) -> dict[str, dict[str, dict[str, Any]]]:
    """Effect name -> parameter name -> value, 95 % interval and unit."""
    out: dict[str, dict[str, dict[str, Any]]] = {}
    k = len(BASE_WIDTH)
    model = fit.model
    for effect, own, values in zip(model.effects, model.parameters, model.values(fit.p), strict=True):
        entry = {}
        for parameter, value in zip(own, values, strict=True):
            half = 1.96 * float(np.sqrt(fit.p_covariance[k, k]))
            if is_factor(parameter):
                low, high = value * np.exp(-half), value * np.exp(half)
            else:
                half *= 0.5 * (parameter.high - parameter.low)
                low, high = value - half, value + half
            if parameter.choices or effect.scatter:
                low = high = value
            entry[parameter.name] = {
                "value": float(value),
                "ci95": [float(low), float(high)],
                "unit": parameter.unit,
            }
            if (name := parameter.called(float(value))) is not None:
                entry[parameter.name]["choice"] = name
            k += 1
        out[effect.name] = entry
    return out


def base_values(fit: Fit) -> dict[str, float]:
    """The base law's parameters by their names."""
    k_l, k_ul, k_t, mu, k_r = fit.model.law(fit.p)
    return dict(zip(BASE_NAMES, map(float, (k_l, k_ul, k_t, np.rad2deg(np.arctan(mu)), k_r)), strict=True))


def diagnosis_json(result: Diagnosis) -> dict[str, Any]:
    """The content of diagnosis.json (schema 2)."""
    head: dict[str, Any] = {"schema": 2, "experiment": result.experiment.name}
    sanity = {
        "faults": [fault.message for fault in result.sanity.faults],
        "fault_codes": [fault.code for fault in result.sanity.faults],
        "remarks": result.sanity.remarks,
    }
    body = _faulty_json(result) if result.found is None else _found_json(result)
    return head | body | {"sanity": sanity}


def _faulty_json(result: Diagnosis) -> dict[str, Any]:
    """What diagnosis.json holds of an experiment that could not be diagnosed."""
    names = list(catalogue())
    suspects = result.sanity.suspects or ["none", *names]
    probabilities = {"none": 0.0, "unknown": UNKNOWN_IF_FAULTY, **dict.fromkeys(names, 0.0)}
    for name in suspects:  # nothing was tried, so all are equally likely
        probabilities[name] += (1.0 - UNKNOWN_IF_FAULTY) / len(suspects)
    gap = dict.fromkeys(("base", "augmented", "noise_floor", "closure", "closure_ci95"))
    return {
        "base": {}, "verdict": "unknown", "group": [], "probabilities": probabilities, "effects": {}, "where": [],
        "gap": {"unit": GAP_UNIT} | gap, "next_release": "", "causes": [], "outside": None, "floor": None,
    }  # fmt: skip


def _found_json(result: Diagnosis) -> dict[str, Any]:
    """What diagnosis.json holds of an experiment that was diagnosed."""
    names, found, data = list(catalogue()), result.found, result.data
    assert found is not None and data is not None and result.gaps is not None and result.cells is not None
    assert result.budget is not None
    zones = result.experiment.cross_section.zone_names
    return {
        "base": base_values(found.base),
        "law": {"rolling_in_indentation": bool(found.base.model.setup.contact[..., INDENTATION].any())},
        "verdict": found.verdict,
        "group": found.group if found.verdict in names else [],
        "probabilities": dict.fromkeys(names, 0.0) | {k: float(v) for k, v in found.probabilities.items()},
        "effects": {
            name: {
                "parameters": effect_values(c.fit)[name],
                "base": base_values(c.fit),
                "heldout_score_gain": c.total,
                "heldout_score_gain_se": c.error,
                "closure": result.gaps[name].share_closed,
                "closure_ci95": list(result.gaps[name].ci95),
            }
            for name, c in found.candidates.items()
        },
        "where": [vars(cell) for cell in result.cells],
        "gap": _gap_json(result.budget),
        "causes": _causes_json(found, result.budget),
        "outside": _outside_json(found, result.budget),
        "floor": {
            "regression": result.budget.regression,
            "replicates": result.budget.replicates,
            "used": result.budget.used,
        },
        "next_release": next_release(data, result.setup, found, result.cells, zones),
        "unexplained": [
            {"dependence": d.name, "heldout_score_gain": d.total, "heldout_score_gain_se": d.error}
            for d in found.unexplained
        ],
        "beside": _chain_json(found) if found.verdict == found.best else [],
        "model": _model_json(found),
        "series": _series(result),
        "blocks": {
            name: {"mass_kg": float(block.mass_kg), "size_m": block.size_m}
            for name, block in result.experiment.blocks.items()
        },
        "gravity_m_s2": float(result.experiment.gravity_m_s2),
        "assumptions": [reading_sentence(found.base)],
    }


def _gap_json(budget: Budget) -> dict[str, Any]:
    """The gap that all causes and learnt changes close together."""
    closed = budget.closed
    return {
        "unit": GAP_UNIT, "base": budget.base, "augmented": budget.learnt, "noise_floor": budget.used,
        "closure": closed.closes, "closure_ci95": list(closed.ci95),
    }  # fmt: skip


def _share_json(share: Share) -> dict[str, Any]:
    return {"closes": share.closes, "closes_ci95": list(share.ci95), "closes_range": list(share.range)}


def _causes_json(found: Attribution, budget: Budget) -> list[dict[str, Any]]:
    """The causes, most probable first: effects of the model with the share that each closes, and others that are
    possible, with the parameters that they have alone."""
    known, joint = catalogue(), effect_values(found.final.fit) if found.named else {}
    chances = inclusion(found.statistics["causes"])
    out = []
    for name in sorted(chances, key=lambda n: -chances[n]):
        if name not in found.named and chances[name] < LEAST_LISTED_PROBABILITY:
            continue
        own = joint[name] if name in joint else effect_values(found.candidates[name].fit)[name]
        share = (
            _share_json(budget.causes[name])
            if name in budget.causes
            else dict.fromkeys(("closes", "closes_ci95", "closes_range"))
        )
        out.append(
            {
                "effect": name,
                "p": chances[name],
                "parameters": own,
                "origin": known[name].origin,
                "group": found.rivals.get(name, []),
            }
            | share
        )
    return out


def _outside_json(found: Attribution, budget: Budget) -> dict[str, Any]:
    """What depends on something, but has no name."""
    changes = found.learnt.changes
    names = [change.basis.name for change in changes] + [d.basis.name for d in found.unexplained]
    return {
        "p": outside(found.statistics["outside"]),
        "share": budget.outside.closes,
        "share_ci95": list(budget.outside.ci95),
        "depends_on": list(dict.fromkeys(names)),
        "learnt": {
            "closes": budget.closed_by_learnt.closes,
            "closes_ci95": list(budget.closed_by_learnt.ci95),
            "changes": [change.name for change in changes],
        }
        if changes
        else None,
    }


def reported_effect(found: Attribution) -> str:
    """The effect whose gap is reported."""
    named = [name for name, c in found.candidates.items() if name == found.verdict or not c.effect.scatter]
    return max(named, key=lambda name: found.candidates[name].total)


def reading_sentence(base: Fit) -> str:
    """Which reading of the paper's rolling resistance fits the data better, as a sentence."""
    if base.model.setup.contact[..., INDENTATION].any():
        return (
            "The paper's rolling resistance can be read in two ways. In the reading that fits these data better, the "
            "rolling spring acts until the block is clear of the original surface."
        )
    return (
        "The paper's rolling resistance can be read in two ways. In the reading that fits these data better, the "
        "rolling spring acts only while the ground presses on the block."
    )


def _model_json(found: Attribution) -> dict[str, Any] | None:
    """All causes, with the base law that was fitted with them; and the same with the learnt changes, for predictions of
    this set-up. None without any."""
    learnt = found.learnt
    if not (found.named or learnt.changes):
        return None
    plain = found.final.fit if found.named else found.base
    changed = {
        "base": base_values(learnt.fit),
        "parameters": effect_values(learnt.fit),
        "changes": [
            change.basis.content()
            | {
                "lever": change.lever,
                "coefficients": change.coefficients.tolist(),
                "heldout_score_gain": change.total,
                "heldout_score_gain_se": change.error,
            }
            for change in learnt.changes
        ],
    }
    return {
        "base": base_values(plain),
        "parameters": effect_values(plain),
        "learnt": changed if learnt.changes else None,
    }


def _chain_json(found: Attribution) -> list[dict[str, Any]]:
    """The effects beside the verdict, each with the parameters of all effects."""
    return [
        {
            "effect": c.effect.name,
            "base": base_values(c.fit),
            "parameters": effect_values(c.fit),
            "heldout_score_gain": c.total,
            "heldout_score_gain_se": c.error,
        }
        for c in found.chain[1:]
    ]


def _series(result: Diagnosis) -> dict[str, int]:
    """Releases of each block that were filmed, for effects that change from release to release."""
    names = list(result.experiment.blocks)
    if isinstance(result.data, FilmData):
        blocks = result.data.film.release_block
    else:
        assert result.data is not None
        blocks = result.data.impact_block[np.unique(result.data.impact_release, return_index=True)[1]]
    return {name: int((blocks == i).sum()) for i, name in enumerate(names)}
