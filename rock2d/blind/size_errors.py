"""Errors of the sizes of named effects, for effects of which a parameter of the catalogue and a value of the reality
engine have the same meaning.

The reality engine has several forms of each effect. A form whose value means something else, such as a drag with
another power of speed, is not compared."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

import numpy as np

from rock2d.effects import catalogue
from rock2d.statistics import wilson_share

LARGEST_ERROR = 0.25  # largest relative error of a size that counts as right


@dataclass(frozen=True)
class Meaning:
    """The compared quantity of an effect.

    Attributes
    ----------
    parameter : name of the parameter in the catalogue
    of : (values of the reality engine) -> value of this parameter
    neutral : value without the effect, which is the origin of sizes
    form : number of the form of the reality engine with the same meaning"""

    parameter: str
    of: Callable[[Mapping[str, float]], float]
    neutral: float = 0.0
    form: int = 0


MEANINGS = {
    "air_drag": Meaning("drag_per_mass_1_m", lambda v: v["drag"]),
    "angle_offset": Meaning("offset_rad", lambda v: v["offset_rad"]),
    "camera_tilt": Meaning("tilt_rad", lambda v: v["turn_rad"]),
    "flight_damping": Meaning("rate_1_s", lambda v: v["rate_1_s"]),
    "frame_rate_error": Meaning("time_scale", lambda v: v["factor"], 1.0),
    "geometry_error": Meaning("facing_rad", lambda v: v["turn_rad"]),
    "inertia_error": Meaning("factor", lambda v: float(np.exp(np.mean(np.log(list(v.values()))))), 1.0),
    "magnus_lift": Meaning("lift_per_mass", lambda v: v["lift"]),
    "scale_error": Meaning("scale", lambda v: v["y"], 1.0),
    "surface_roughness": Meaning("sd_rad", lambda v: v["sd_rad"]),
    "zone_contrast": Meaning("stiffness", lambda v: v["k_l"], 1.0),
}


@dataclass(frozen=True)
class SizeError:
    """Size of one named and hidden effect.

    Attributes
    ----------
    relative : (fitted - hidden size) / hidden size; for factors, of their logarithms
    covered : whether the stated 95 % interval holds the hidden size"""

    effect: str
    relative: float
    covered: bool


def size_errors(label: Mapping[str, Any], causes: Iterable[Mapping[str, Any]]) -> list[SizeError]:
    """Errors of the sizes of named effects, from a label and the `causes` of a diagnosis."""
    of_record = label.get("of_record", [])  # their sizes are not only those that were added
    hidden = {str(truth["name"]): truth for truth in label["hidden"] if truth["name"] not in of_record}
    found = []
    for cause in causes:
        effect, truth = cause["effect"], hidden.get(cause["effect"])
        meaning = MEANINGS.get(effect)
        if "base" in label and effect in hidden:
            first = catalogue()[effect].parameters[0]
            meaning = Meaning(first.name, itemgetter(first.name), first.neutral)
        if truth is None or meaning is None or not cause["named"] or int(truth["form"]) != meaning.form:
            continue
        if (fitted := cause["parameters"].get(meaning.parameter)) is None:
            continue
        value, low, high = (_size(meaning, x) for x in (fitted["value"], *fitted["ci95"]))
        size = _size(meaning, meaning.of(truth["values"]))
        found.append(SizeError(effect, value / size - 1.0, low <= size <= high))
    return found


def _size(meaning: Meaning, value: float) -> float:
    return float(np.log(value / meaning.neutral)) if meaning.neutral else float(value)


def size_summary(errors: Iterable[SizeError]) -> dict[str, Any]:
    """For all effects, and for each: number, median of the relative errors and of their absolute values, the share
    within LARGEST_ERROR and the share of intervals that hold the hidden size, with 95 % Wilson intervals."""
    errors = list(errors)
    groups = {"all": errors} | {
        effect: own for effect in MEANINGS if (own := [e for e in errors if e.effect == effect])
    }
    return {name: _summary(own) for name, own in groups.items()}


def median(values: list[float]) -> float:
    """The median; NaN without values."""
    return float(np.median(values)) if len(values) else float("nan")


def _summary(errors: list[SizeError]) -> dict[str, Any]:
    relative = [e.relative for e in errors]
    return {
        "count": len(errors),
        "median": median(relative),
        "median_absolute": median([abs(error) for error in relative]),
        "within": wilson_share([abs(e.relative) <= LARGEST_ERROR for e in errors]),
        "covered": wilson_share([e.covered for e in errors]),
    }
