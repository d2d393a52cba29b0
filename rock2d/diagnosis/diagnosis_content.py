"""The content of diagnosis.json: the results of a diagnosis as numbers and words."""

from collections.abc import Collection, Sequence
from typing import Any

import numpy as np

from rock2d.arrays import Array
from rock2d.diagnosis.attribution import Attribution, Candidate, inclusion_probabilities
from rock2d.diagnosis.budget import GAP_UNIT, Budget, Share
from rock2d.diagnosis.cause_sets import GRAVITY_POWERS, TWINS
from rock2d.diagnosis.data import Data, FilmData
from rock2d.diagnosis.diagnose import Diagnosis
from rock2d.diagnosis.fitting import Fit
from rock2d.diagnosis.gap import Cell
from rock2d.diagnosis.learnt import Change
from rock2d.diagnosis.levers import FLIGHT, Dependence
from rock2d.diagnosis.likelihood import chi_square
from rock2d.diagnosis.model import BASE_NAMES, Model, is_factor
from rock2d.diagnosis.significance import SummedGain
from rock2d.diagnosis.visibility import SPIN_TWINS
from rock2d.effects import catalogue
from rock2d.effects.effect import Effect
from rock2d.effects.flight import AIR_DRAG, drag_coefficient
from rock2d.laws.contact import ROLLING_IN_INDENTATION
from rock2d.records.columns import LINEAR_VELOCITY, N_STATE, OMEGA
from rock2d.scene.world import World
from rock2d.wording import three_digits

LEAST_LISTED_PROBABILITY = 0.05  # smallest probability of an unnamed cause in the list of causes
# relative standard deviation of the size of an effect: no law is exactly that of the ground, the air or the camera;
# measured on films whose effects are known (`blind.size_errors`). The soil's scatter takes a part of an effect that
# widens the scatter.
MODEL_ERROR, SCATTER_MODEL_ERROR = 0.02, 0.25
NO_SHARE: dict[str, Any] = dict.fromkeys(("closes", "closes_ci95", "closes_range"))  # for an unknown share
UNKNOWN_IF_FAULTY = 0.5  # probability of "unknown" for an experiment that could not be diagnosed
FEWEST_IMPACTS_OF_A_KIND = 3  # smallest number of impacts for a proposal
# releases that differ from the filmed ones: text, factor on speed, spin added in √(g / radius)
POSSIBLE_RELEASES = (
    ("as filmed", 1.0, 0.0),
    ("1.5 times as fast", 1.5, 0.0),
    ("two thirds as fast", 0.67, 0.0),
    ("with more clockwise spin", 1.0, -1.0),
    ("with more counter-clockwise spin", 1.0, 1.0),
)


def effect_values(fit: Fit) -> dict[str, dict[str, dict[str, Any]]]:
    """Effect name -> parameter name -> value, 95 % interval and unit."""
    values_of_effects: dict[str, dict[str, dict[str, Any]]] = {}
    model = fit.model
    for effect, parameters, values in zip(model.effects, model.parameters, model.values(fit.p), strict=True):
        entries, first = [], model.positions[effect.name].start
        model_error = SCATTER_MODEL_ERROR if effect.scatter else MODEL_ERROR
        for k, (parameter, value) in enumerate(zip(parameters, values, strict=True), first):
            half = 1.96 * float(np.hypot(np.sqrt(fit.p_covariance[k, k]), model_error * fit.p[k]))
            if is_factor(parameter):
                low, high = value * np.exp(-half), value * np.exp(half)
            else:
                half *= 0.5 * (parameter.high - parameter.low)
                low, high = value - half, value + half
            if parameter.choices:
                low = high = value
            if parameter.low == parameter.neutral:  # one-sided, such as a standard deviation
                low = max(low, min(parameter.low, value))
            entries.append({"value": float(value), "ci95": [float(low), float(high)], "unit": parameter.unit})
            if (name := parameter.choice_name(float(value))) is not None:
                entries[-1]["choice"] = name
        size = len(effect.parameters)
        values_of_effects[effect.name] = {
            parameter.name: _mean_and_blocks(model, effect, entries[j::size])
            if model.has_own_parameters(effect)
            else entries[j]
            for j, parameter in enumerate(effect.parameters)
        }
    return values_of_effects


def _mean_and_blocks(model: Model, effect: Effect, entries: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """A parameter with a value for each block: the mean, and the values of all blocks that flew."""
    each = {
        name: {key: entry[key] for key in ("value", "ci95")} for name, entry in zip(model.flown, entries, strict=True)
    }
    value = float(np.mean([entry["value"] for entry in each.values()]))
    half = float(np.linalg.norm([0.5 * np.ptp(entry["ci95"]) for entry in each.values()])) / len(each)
    for name, entry in each.items() if effect.name == AIR_DRAG.name else ():
        factor = drag_coefficient(model.setup.blocks[name], 1.0)
        entry["drag_coefficient"] = {"value": factor * entry["value"], "ci95": [factor * end for end in entry["ci95"]]}
    return {"value": value, "ci95": [value - half, value + half], "unit": entries[0]["unit"], "by_block": each}


def base_values(fit: Fit) -> dict[str, float]:
    """Parameter of the base law -> value."""
    k_l, k_ul, k_t, mu, k_r = fit.model.law(fit.p)
    return dict(zip(BASE_NAMES, map(float, (k_l, k_ul, k_t, np.rad2deg(np.arctan(mu)), k_r)), strict=True))


def diagnosis_json(result: Diagnosis) -> dict[str, Any]:
    """The content of diagnosis.json (schema 3)."""
    head: dict[str, Any] = {"schema": 3, "experiment": result.experiment.name}
    sanity = {
        "faults": [fault.message for fault in result.sanity.faults],
        "fault_codes": [fault.code for fault in result.sanity.faults],
        "remarks": result.sanity.remarks,
    }
    body = _faulty_json(result) if result.found is None else _found_json(result)
    film = None
    if result.film is not None:
        film = result.film.content() | {"said": film_sentences(result)}
    return head | body | {"film": film, "sanity": sanity}


def film_sentences(result: Diagnosis) -> list[str]:
    """What the film says of itself, and whether the diagnosis agrees. The film alone shows neither the spin nor the
    forces in flight nor the contacts."""
    film, attribution = result.film, result.found
    if film is None:
        return []
    sentences = film.sentences()
    if attribution is None:
        return sentences
    names = {effect for name in attribution.named for effect in (name, *attribution.group(name))}
    if not ((film.off and not TWINS.keys() & names) or (film.turned and "camera_tilt" not in names)):
        return sentences
    certainty = dict.fromkeys(sorted(attribution.named), "") | dict.fromkeys(attribution.uncertain, " (not certain)")
    acting = [name + said for name, said in certainty.items() if catalogue()[name].phase != "impact"]
    learnt = [change.name for change in attribution.learnt.changes if change.lever == FLIGHT]
    if acting or learnt:
        return [
            *sentences,
            f"the diagnosis, which knows more, explains gravity in the flights by {', '.join([*acting, *learnt])}",
        ]
    return [*sentences, "the diagnosis, which knows more, finds nothing that explains gravity in the flights"]


def _faulty_json(result: Diagnosis) -> dict[str, Any]:
    """The content for an experiment that could not be diagnosed."""
    names = list(catalogue())
    film = result.film.suspects if result.film is not None else []
    suspects = film or result.sanity.suspects or ["none", *names]
    probabilities = {"none": 0.0, "unknown": UNKNOWN_IF_FAULTY, **dict.fromkeys(names, 0.0)}
    for name in suspects:  # no effect was tried, so all are equally probable
        probabilities[name] += (1.0 - UNKNOWN_IF_FAULTY) / len(suspects)
    gap = dict.fromkeys(("base", "augmented", "noise_floor", "closure", "closure_ci95"))
    return {
        "base": {}, "verdict": "unknown", "group": [], "probabilities": probabilities, "effects": {}, "where": [],
        "gap": {"unit": GAP_UNIT} | gap, "next_release": "", "causes": _film_causes_json(result, probabilities),
        "outside": None, "floor": None,
    }  # fmt: skip


def _film_causes_json(result: Diagnosis, probabilities: dict[str, float]) -> list[dict[str, Any]]:
    """The effects that gravity in the flights suggests, each with the size that it would have alone."""
    known, film = catalogue(), result.film
    if film is None:
        return []
    return [
        {
            "effect": name,
            "p": probabilities[name],
            "parameters": film.parameters()[name],
            "origin": known[name].origin,
            "group": [other for other in film.suspects if other != name],
            "named": False,
        }
        | NO_SHARE
        for name in film.suspects
    ]


def _found_json(result: Diagnosis) -> dict[str, Any]:
    """The content for an experiment that was diagnosed."""
    names, attribution, data = list(catalogue()), result.found, result.data
    assert attribution is not None and data is not None and result.shares is not None and result.cells is not None
    assert result.budget is not None
    ground = result.experiment.cross_section
    zones = ground.zone_names
    return {
        "base": base_values(attribution.base.fit),
        "law": {
            "rolling_in_indentation": bool(attribution.base.fit.model.setup.contact[..., ROLLING_IN_INDENTATION].any()),
            "fitted": bool(len(data.impact_release)),
        },
        "verdict": attribution.verdict,
        "group": [attribution.verdict, *attribution.group(attribution.verdict)] if attribution.verdict in names else [],
        "probabilities": dict.fromkeys(names, 0.0) | {k: float(v) for k, v in attribution.probabilities.items()},
        "effects": {
            name: {"parameters": effect_values(c.fit)[name], "base": base_values(c.fit)}
            | _gain_json(c)
            | {"closure": result.shares[name].closes, "closure_ci95": list(result.shares[name].ci95)}
            for name, c in attribution.candidates.items()
        },
        "where": [vars(cell) for cell in result.cells],
        "gap": _gap_json(result.budget),
        "causes": _causes_json(attribution, result.budget, result.unseen or {}),
        "outside": _outside_json(attribution, result.budget),
        "floor": {
            "regression": result.budget.regression,
            "replicates": result.budget.replicates,
            "used": result.budget.used,
        },
        "next_release": next_release(data, result.setup, attribution, result.cells, zones),
        "unexplained": [{"dependence": d.name} | _gain_json(d) for d in attribution.unexplained],
        "beside": beside_verdict(attribution),
        "model": _model_json(attribution),
        "predicted": result.predicted.content(result.seed or 0) if result.predicted is not None else None,
        "physical": _physical_json(result),
        "checks": result.checks.content() if result.checks is not None else [],
        "series": _series(result),
        "blocks": {
            name: {"mass_kg": float(block.mass_kg), "size_m": block.size_m, "shape": block.shape}
            for name, block in result.experiment.blocks.items()
        },
        "cross_section": {"points_m": ground.points_m.tolist(), "zones": list(ground.zones)},
        "gravity_m_s2": float(result.experiment.gravity_m_s2),
        "unseen": result.unseen,
        "assumptions": [reading_sentence(attribution.base.fit)],
    }


def _gain_json(gain: SummedGain) -> dict[str, float]:
    return {"heldout_score_gain": gain.total, "heldout_score_gain_se": gain.error}


def _law_json(fit: Fit) -> dict[str, Any]:
    """The base law with all effects of a fit."""
    return {"base": base_values(fit), "parameters": effect_values(fit)}


def _gap_json(budget: Budget) -> dict[str, Any]:
    """The gap that all causes and learnt changes close together."""
    closed = budget.closed
    return {
        "unit": GAP_UNIT, "base": budget.base, "augmented": budget.learnt, "noise_floor": budget.used,
        "closure": closed.closes, "closure_ci95": list(closed.ci95),
    }  # fmt: skip


def _share_json(share: Share) -> dict[str, Any]:
    return {"closes": share.closes, "closes_ci95": list(share.ci95), "closes_range": list(share.range)}


def _causes_json(attribution: Attribution, budget: Budget, unseen: Collection[str]) -> list[dict[str, Any]]:
    """The causes, most probable first: effects of the model with the share that each closes, and other possible effects
    with their parameters as a single effect."""
    effects, joint_values = catalogue(), effect_values(attribution.final.fit) if attribution.named else {}
    probabilities = inclusion_probabilities(attribution.evidence)
    out = []
    for name in sorted(probabilities, key=lambda n: -probabilities[n]):
        if name not in attribution.named and probabilities[name] < LEAST_LISTED_PROBABILITY:
            continue
        values = joint_values[name] if name in joint_values else effect_values(attribution.candidates[name].fit)[name]
        share = _share_json(budget.causes[name]) if name in budget.causes else NO_SHARE
        out.append(
            {
                "effect": name,
                "p": probabilities[name],
                "parameters": values,
                "origin": effects[name].origin,
                "group": attribution.group(name)
                + [other for other, twin in SPIN_TWINS.items() if twin == name and other in unseen],
                "named": name in attribution.named,
                "common": _common_quantity(name, values) if TWINS.get(name) in attribution.group(name) else None,
            }
            | share
        )
    return out


def _common_quantity(name: str, parameters: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """The quantity that an error of scale and an error of frame rate change alike: gravity in flights over stated
    gravity."""
    key, power = GRAVITY_POWERS[name]
    low, high = parameters[key]["ci95"]
    return {
        "name": "gravity in flights over gravity as stated",
        "value": parameters[key]["value"] ** power,
        "ci95": [low**power, high**power],
        "unit": "1",
    }


def _outside_json(attribution: Attribution, budget: Budget) -> dict[str, Any]:
    """The part of the gap that depends on measured quantities, but is in no cause."""
    changes = attribution.learnt.changes
    dependences: list[Change | Dependence] = [*changes, *attribution.unexplained]
    dependences.sort(key=lambda dependence: -dependence.total)
    return {
        "p": attribution.outside,
        "share": budget.outside.closes,
        "share_ci95": list(budget.outside.ci95),
        "depends_on": list(dict.fromkeys(d.basis.name for d in dependences)),
        "learnt": {
            "closes": budget.closed_by_learnt.closes,
            "closes_ci95": list(budget.closed_by_learnt.ci95),
            "changes": [change.name for change in changes],
            "effects": attribution.uncertain,
        }
        if changes
        else None,
    }


def reported_effect(attribution: Attribution) -> str:
    """The effect whose gap is reported."""
    named = [name for name, c in attribution.candidates.items() if name == attribution.verdict or not c.effect.scatter]
    return max(named, key=lambda name: attribution.candidates[name].total)


def reading_sentence(base: Fit) -> str:
    """A sentence on the reading of the paper's rolling resistance that fits the data better."""
    if not len(base.residuals.impacts):
        return (
            "No impact could be judged. The law of the ground is the paper's, scaled to the size and mass of the "
            "blocks; it was not fitted."
        )
    acts = "only while the ground presses on the block"
    if base.model.setup.contact[..., ROLLING_IN_INDENTATION].any():
        acts = "until the block is clear of the original surface"
    return (
        "The paper's rolling resistance can be read in two ways. In the reading that fits these data better, the "
        f"rolling spring acts {acts}."
    )


def _model_json(attribution: Attribution) -> dict[str, Any] | None:
    """The base law fitted with all causes; and the same with the learnt changes, for predictions of this set-up. None
    without causes and learnt changes."""
    learnt = attribution.learnt
    if not (attribution.named or learnt.changes):
        return None
    changes = [
        change.basis.content(learnt.fit.model.setup)
        | {"lever": change.lever, "coefficients": change.coefficients.tolist()}
        | _gain_json(change)
        for change in learnt.changes
    ]
    changed = _law_json(learnt.fit) | {"changes": changes} if changes else None
    return _law_json(attribution.settled) | {"learnt": changed}


def beside_verdict(attribution: Attribution) -> list[dict[str, Any]]:
    """The other effects of the chain, each with the parameters of all effects; none if the verdict is not in it."""
    others = [c for c in attribution.chain if c is not attribution.answer] if attribution.answer else []
    return [{"effect": c.effect.name} | _law_json(c.fit) | _gain_json(c) for c in others]


def _physical_json(result: Diagnosis) -> dict[str, dict[str, float]]:
    """Median errors for held-out releases: velocity after an impact, position and angle at the end of a segment."""
    assert result.found is not None
    models = (result.found.base.held_out, result.found.learnt.held_out)
    errors = [np.hypot(*model.residuals.impacts[:, -3:-1].T) for model in models]
    speeds = [model[np.isfinite(model)] for model in errors]
    misses = {"m_s": [float(np.median(model)) for model in speeds]} if all(map(len, speeds)) else {}
    if result.predicted is not None:
        misses |= dict(zip(("mm", "deg"), map(list, zip(*result.predicted.ends, strict=True)), strict=True))
    return {
        unit: {"base": base, "augmented": augmented}
        for unit, (base, augmented) in misses.items()
        if np.isfinite(base + augmented)
    }


def _series(result: Diagnosis) -> dict[str, int]:
    """Block -> number of filmed releases, for effects that change from release to release."""
    data = result.data
    assert data is not None
    blocks = data.film.release_block if isinstance(data, FilmData) else data.release_block
    return {name: int((blocks == i).sum()) for i, name in enumerate(result.experiment.blocks)}


def next_release(
    data: Data, setup: World, attribution: Attribution, cells: Sequence[Cell], zones: Sequence[str]
) -> str:
    """A sentence: what to film next to separate the best effect from its closest rival. It is the release for which
    both predict the most different outcomes."""
    if not len(data.impact_release):
        return "A film that continues after the blocks strike the ground: this one shows no impacts."
    if attribution.verdict == "unknown":
        if not cells:
            return "More releases of every block: these data cannot separate the gap from noise."
        cell = cells[0]
        return (
            f"More releases that show {_place(cell)}: most of the gap lies there, "
            "and nothing in the catalogue explains it."
        )
    candidates = attribution.candidates
    first = candidates.get(attribution.verdict, candidates[attribution.strongest])
    known = {first.effect.name, *attribution.named}
    rivals = [c for name, c in candidates.items() if name not in known and not c.effect.scatter]
    if not rivals or first.effect.scatter:
        return "More releases of every block: only many releases separate a scatter from a shift."
    second = max(rivals, key=lambda c: c.total)
    names = f"{first.effect.name} and {second.effect.name}"
    best, proposal = 0.0, ""
    for text, faster, spin in POSSIBLE_RELEASES:
        distance = _distance(data, setup, first, second, faster, spin)
        for block in range(len(setup.blocks)):
            for zone in range(len(zones)):
                rows = (data.impact_block == block) & (data.impact_zone == zone) & np.isfinite(distance)
                if rows.sum() >= FEWEST_IMPACTS_OF_A_KIND and (typical := float(np.median(distance[rows]))) > best:
                    pace = float(np.median(np.hypot(*data.incident(setup)[rows, LINEAR_VELOCITY].T))) * faster
                    best = typical
                    name = list(setup.blocks)[block]
                    article = "an" if name[0].lower() in "aeiou" else "a"
                    proposal = f"{article} {name} that strikes the {zones[zone]} at {pace:.2g} m/s ({text})"
    if not proposal:
        return f"Longer flights: no impact separates {names}."
    lead = "" if attribution.verdict != "none" else "No effect stands out. "
    difference = f"there {names} differ by {three_digits(best)} standard deviations in one impact."
    return f"{lead}{proposal[0].upper()}{proposal[1:]}: {difference}"


def _place(cell: Cell) -> str:
    if cell.phase == "flight":
        return f"flights of the {cell.block} above the {cell.zone}"
    return f"impacts of the {cell.block} on the {cell.zone}"


def _distance(data: Data, setup: World, first: Candidate, second: Candidate, faster: float, spin: float) -> Array:
    """(n,) distance between the predictions of two models for each impact, in standard deviations."""
    radius = setup.radii_m[data.impact_block]
    shift = np.zeros((len(radius), N_STATE))
    shift[:, LINEAR_VELOCITY] = (faster - 1.0) * data.incident(setup)[:, LINEAR_VELOCITY]
    shift[:, OMEGA] = spin * np.sqrt(setup.gravity_m_s2 / radius)
    residuals = [data.residuals(c.fit.model.world(c.fit.p, data.impact_order), shift).impacts for c in (first, second)]
    difference = residuals[0] - residuals[1]
    chi2 = chi_square(difference, first.fit.covariance(), np.inf)
    return np.where(np.isfinite(difference).all(axis=1), np.sqrt(np.maximum(chi2, 0.0)), np.nan)
