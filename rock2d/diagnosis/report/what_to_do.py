"""What to do after a diagnosis: correct the record, measure, change the model, film another release, or nothing.

Keys of files and commands stand in backticks."""

from collections.abc import Mapping
from typing import Any

from rock2d.diagnosis.cause_sets import TWINS
from rock2d.diagnosis.moving_frame import RELEASE
from rock2d.diagnosis.report import text
from rock2d.effects import catalogue
from rock2d.effects.fitted_effect import FittedEffect
from rock2d.files.experiment import Experiment
from rock2d.kinematics import sanity
from rock2d.kinematics.setup_world import setup_world
from rock2d.wording import listed, number, percent, spoken

LEAST_PROBABILITY = 0.5  # smallest probability of a verdict to act on
MEASURE_SCALE_AND_RATE = (
    "Measure a length in the plane of motion, and film a clock: one of scale and frame rate is wrong"
)
UNIT_FAULTS = {
    sanity.FRAME_RATE, sanity.LENGTH_UNIT, sanity.ANGLE_UNIT, sanity.CONSTANT_ANGLE, sanity.NO_MOTION,
    sanity.WRONG_GRAVITY,
}  # fmt: skip
AXIS_FAULTS = {
    sanity.BELOW_GROUND, sanity.ABOVE_GROUND, sanity.BESIDE_GROUND, sanity.UPWARD_GRAVITY, sanity.ENERGY_GAIN
}  # fmt: skip


def what_to_do(content: Mapping[str, Any], experiment: Experiment) -> list[str]:
    """Sentences on the next steps, from the content of diagnosis.json, the most important first."""
    verdict = content["verdict"]
    if content["sanity"]["faults"]:
        return _after_faults(content)
    if verdict == "none":
        fitted = content.get("law", {}).get("fitted", True)
        asked = [remark for remark in content["sanity"]["remarks"] if remark.endswith("?")]
        return [
            *(f"Answer this first; if it is wrong, nothing else here holds: {remark}" for remark in asked),
            ("If all is right there, correct nothing." if asked else "Correct nothing.")
            + " Go on with the law as it was refitted (`base` in diagnosis.json)." * fitted,
            "A weak effect may still hide in noise and soil. More releases, or the one below, would show it.",
            *_next_release(content),
        ]
    if verdict not in catalogue():
        part = text.explained_part(content)
        return [
            f"Check the set-up for {part}. Correct nothing that you cannot confirm there: the rest of the gap has a "
            "cause outside the catalogue, and these effects may explain a part that belongs to it."
            if part
            else "Do not correct anything: no effect of the catalogue can be named, and the likeliest one may be a "
            "wrong correction.",
            *_moving_frame(content),
            *_learnt(content),
            "Look at the places with the largest share of the gap and at the impacts with the largest residuals in the "
            "film. If you find the cause, add it to the catalogue as an effect (one file, see CONTRIBUTING.md).",
            *_next_release(content),
        ]
    return _after_effect(content, experiment)


def _moving_frame(content: Mapping[str, Any]) -> list[str]:
    """A sentence on a frame that moves differently in each release, if something outside the catalogue acts so."""
    outside = content.get("outside")
    if outside is None or outside["p"] < LEAST_PROBABILITY or RELEASE.name not in outside["depends_on"]:
        return []
    return [
        "In each release the picture lies or slides differently against the ground. Look at a fixed mark in the film "
        "of each release. If it moves, subtract its motion from the record, and fix the camera before the next film. "
        "If it does not, the ground moves, or the blocks are not of one size."
    ]


def _learnt(content: Mapping[str, Any]) -> list[str]:
    """A sentence on the use of learnt changes, if there are any."""
    if not (learnt := text.learnt(content)):
        return []
    beside = ""
    if uncertain := listed(learnt["effects"]):
        beside = f" It also uses {uncertain}: predictions are better with them, but they are not certain."
    return [
        "Predict other releases of this set-up with `rock2d predict`: it uses what was learnt from the film. The "
        f"learnt curves show where and how the motion differs.{beside}"
    ]


def _after_effect(content: Mapping[str, Any], experiment: Experiment) -> list[str]:
    """Advice for a verdict that is an effect: on the effect, its rivals, and further causes."""
    verdict, chance = content["verdict"], content["probabilities"][content["verdict"]]
    lines = []
    rivals = [name for name in content["group"] if name != verdict]
    if rivals or chance < LEAST_PROBABILITY:
        twins = rivals == [TWINS.get(verdict)]
        doubt = f"cannot tell {listed([verdict, *rivals])} apart" if rivals else "leave it open"
        lines.append(
            f"{MEASURE_SCALE_AND_RATE}; these data cannot tell which."
            if twins
            else f"Do not correct anything yet: these data {doubt} ({spoken(verdict)}: {percent(chance)}). "
            "First film the next release, and diagnose again with it."
        )
        lines += [] if twins else _next_release(content)
        lines += [
            f"If it is {spoken(name)}: {_instruction_for(content, name, experiment)}"
            for name in (verdict, *rivals)
            if name in content["effects"]
        ]
    else:
        lines.append(_instruction_for(content, verdict, experiment))
    beside = [entry["effect"] for entry in content.get("beside", [])]
    if beside:
        lines.append(
            f"{listed(beside).capitalize()} {'was' if len(beside) == 1 else 'were'} found as well. Correct one "
            "cause at a time, and diagnose again after each: these numbers hold only together."
        )
        lines += [
            _rivals_sentence(content, name) + instruction(name, content["beside"][-1], experiment) for name in beside
        ]
    lines += _moving_frame(content)
    if not all(catalogue()[name].camera for name in (verdict, *beside)):
        lines.append(
            "Until then, `rock2d predict OTHER --diagnosis diagnosis.json --out predictions.csv` predicts other "
            "films of this set-up with the effect."
        )
    return lines


def _rivals_sentence(content: Mapping[str, Any], name: str) -> str:
    """Introduction to the instruction about a further cause, if these data cannot distinguish it from others."""
    rivals: list[str] = next((own["group"] for own in content.get("causes", []) if own["effect"] == name), [])
    if not rivals:
        return ""
    measure = f" {MEASURE_SCALE_AND_RATE}." if TWINS.get(name) in rivals else ""
    return f"These data cannot tell {listed([name, *rivals])} apart.{measure} If it is {spoken(name)}: "


def _instruction_for(content: Mapping[str, Any], name: str, experiment: Experiment) -> str:
    """The instruction about an effect; for the verdict, with the parameters of the joint fit."""
    if name == content["verdict"] and content.get("beside"):
        return instruction(name, content["beside"][-1], experiment)
    own = content["effects"][name]
    fit = {"base": own.get("base", content["base"]), "parameters": {name: own["parameters"]}}
    return instruction(name, fit, experiment)


def instruction(name: str, fit: Mapping[str, Any], experiment: Experiment) -> str:
    """What to do about one effect; `fit` has `base` and `parameters` (effect -> its parameters)."""
    effect, table = catalogue()[name], experiment.impacts is not None
    fitted = FittedEffect.of(
        effect, fit["parameters"][name], fit["base"], setup_world(experiment), experiment.fps, table
    )
    return _not_measured(fitted) + (effect.remedy or generic)(fitted)


def _not_measured(fitted: FittedEffect) -> str:
    """Sentences on the values at which the fit stopped, because no larger or smaller ones are plausible."""
    said = ""
    for block, parameter in fitted.ended():
        unit = text.in_degrees(parameter, 0.0)[1]
        said += (
            f"The fit stopped at an end of the plausible range ({text.plausible_range(parameter)}"
            f"{f' {unit}' if unit else ''}) of this value: {f'{spoken(block)}, ' if block else ''}{parameter.meaning}. "
            "It is no measurement; measure it before you correct anything by it. "
        )
    return said


def generic(fitted: FittedEffect) -> str:
    """Instruction for an effect without one of its own: its summary and fitted values."""
    parts = []
    for parameter in fitted.effect.parameters:
        value, unit = text.in_degrees(parameter, fitted.values[parameter.name])
        half, _ = text.in_degrees(parameter, fitted.half[parameter.name])
        parts.append(f"{parameter.meaning}: {number(value, half or None)}{f' {unit}' if unit else ''}")
    found = "; ".join(parts)
    return f"Look in the set-up for what this effect describes, {fitted.effect.summary} ({found}), and measure it."


def _next_release(content: Mapping[str, Any]) -> list[str]:
    said = content["next_release"]
    return [f"Film next: {said}"] if said else []


def _after_faults(content: Mapping[str, Any]) -> list[str]:
    """Advice for an experiment that could not be diagnosed."""
    codes = set(content["sanity"].get("fault_codes", []))
    advice = []
    if codes & {sanity.FEW_RELEASES, sanity.FEW_IMPACTS}:
        advice.append(
            f"Film more releases. At least {sanity.FEWEST_RELEASES} releases with {sanity.FEWEST_IMPACTS} impacts "
            "between two flights are needed to separate causes; about 30 of each block are comfortable."
        )
    if codes & UNIT_FAULTS:
        advice.append("Check the units in the CSV (m, s, rad) and the frame rate in experiment.yaml.")
    if codes & AXIS_FAULTS:
        advice.append(
            "Check that y points up and x towards the embankment, and that film and cross-section have the same origin."
        )
    gravity = (content.get("film") or {}).get("gravity")
    if gravity and gravity["off"]:
        scale, rate = gravity["value_m_s2"] / gravity["stated_m_s2"], gravity["true_fps"]["value"]
        return [
            f"{MEASURE_SCALE_AND_RATE}. If it is the scale, multiply `metres_per_pixel` or `distance_m` by "
            f"{1.0 / scale:.4g}; if it is the frame rate, set `fps: {rate:.6g}`.",
            *advice,
            "Then diagnose again. This diagnosis draws no other conclusion from these data.",
        ]
    return [*advice, "Then diagnose again. This diagnosis draws no conclusions from these data."]
