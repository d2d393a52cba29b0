"""Fitted parameters as a report shows them: value, 95 % interval, and whether the data determine it."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from rock2d.diagnosis.data import FilmData
from rock2d.diagnosis.diagnose import Diagnosis
from rock2d.diagnosis.diagnosis_content import effect_values
from rock2d.diagnosis.fitting import Fit
from rock2d.diagnosis.model import BASE_K_L, BASE_MU, BASE_RATIO, BASE_WIDTH
from rock2d.diagnosis.report.report_data import Models
from rock2d.diagnosis.report.text import in_degrees, plausible_range
from rock2d.graphics.pages import download
from rock2d.wording import interval, number, spoken

UNDETERMINED_WIDTH = 0.7  # share of the prior's width: a parameter with a wider interval is undetermined
LAW = (
    ("k<sub>l</sub>", "loading stiffness", "N/m"),
    ("k<sub>ul</sub>", "unloading stiffness", "N/m"),
    ("k<sub>t</sub>", "tangential stiffness", "N/m"),
    ("φ", "friction angle", "°"),
    ("k<sub>r</sub>", "rolling stiffness", "N m/rad"),
)
SCATTER = ("k<sub>l</sub>", "k<sub>ul</sub> / k<sub>l</sub>", "k<sub>t</sub>", "tan φ", "k<sub>r</sub>")
PARAMETER_COLUMNS = ("model", "parameter", "value", "low95", "high95", "unit")
UNDETERMINED_TEXT = "not determined by these data"


def parameters_section(result: Diagnosis, content: Mapping[str, Any], models: Models) -> dict[str, Any]:
    """Template variables of the parameters. For each model: `law`, the base law's five parameters, and `scatter`, their
    scatter from strike to strike (1 sigma) in %."""
    values = [_law_values(model.fit) for model in models.values()]
    return {
        "law": [(*about, [own[i] for own in values]) for i, about in enumerate(LAW)],
        "scatter": [
            (symbol, [f"{100 * model.fit.scatter[i]:.2g} %" for model in models.values()])
            for i, symbol in enumerate(SCATTER)
        ],
        "effect_rows": _effect_rows(models), "noise": _noise_rows(result, models),
        "parameters_data": download("parameters.csv", PARAMETER_COLUMNS, _every_parameter(content)),
    }  # fmt: skip


def _every_parameter(content: Mapping[str, Any]) -> list[tuple[Any, ...]]:
    """PARAMETER_COLUMNS of the base law, and of every effect with the law fitted together with it."""
    rows = [("base", key, value, None, None, "") for key, value in content["base"].items()]
    for name, effect in content["effects"].items():
        rows += [(name, key, p["value"], *p["ci95"], p["unit"]) for key, p in effect["parameters"].items()]
        rows += [(name, key, value, None, None, "") for key, value in effect.get("base", {}).items()]
    return rows


def _law_values(fit: Fit) -> list[tuple[str, str]]:
    """Value and 95 % interval of each parameter, as texts."""
    law, covariance = fit.model.law(fit.p), fit.p_covariance
    sd = np.sqrt(np.diagonal(covariance)[: len(LAW)])
    undetermined = sd > UNDETERMINED_WIDTH * BASE_WIDTH
    k, r = BASE_K_L, BASE_RATIO  # k_ul = k_l × ratio
    sd[r] = np.sqrt(max(covariance[k, k] + covariance[r, r] + 2.0 * covariance[k, r], 0.0))
    out = []
    for i, value in enumerate(law):
        low, high = value * np.exp([-1.96 * sd[i], 1.96 * sd[i]])
        if i == BASE_MU:
            value, low, high = np.rad2deg(np.arctan([value, low, high]))
        value, low, high = float(value), float(low), float(high)
        if undetermined[i]:
            out.append((number(value), UNDETERMINED_TEXT))
        else:
            out.append((number(value, 0.5 * (high - low)), interval(low, high)))
    return out


def _effect_rows(models: Models) -> list[tuple[str, ...]]:
    """(effect, meaning, unit, value, 95 % interval, plausible range, remark) of each parameter of the effects in the
    model."""
    if (best := models.get("effect")) is None:
        return []
    rows: list[tuple[str, ...]] = []
    model, values = best.fit.model, effect_values(best.fit)
    for effect, parameters in zip(model.effects, model.parameters, strict=True):
        for k, parameter in enumerate(parameters):
            own, meaning, remark = values[effect.name][parameter.name], parameter.meaning, ""
            if model.has_own_parameters(effect):
                block = model.flown[k // len(effect.parameters)]
                own, meaning = own["by_block"][block], f"{spoken(block)}, {meaning}"
                if drag := own.get("drag_coefficient"):
                    remark = f"drag coefficient {number(drag['value'])} ({interval(*drag['ci95'])})"
            value, unit = in_degrees(parameter, own["value"])
            low, high = (in_degrees(parameter, v)[0] for v in own["ci95"])
            if parameter.choices:
                shown, between, plausible = parameter.choice_name(value) or number(value), "", ""
            else:
                shown, between = number(value, 0.5 * (high - low)), interval(low, high) if high > low else ""
                plausible = plausible_range(parameter)
                if np.ptp(own["ci95"]) > UNDETERMINED_WIDTH * 1.96 * (parameter.high - parameter.low):
                    remark = UNDETERMINED_TEXT
                elif parameter.ended_at(own["value"]):
                    remark = "at the end of its plausible range"
            rows.append((effect.name, meaning, unit, shown, between, plausible, remark))
    return rows


def _noise_rows(result: Diagnosis, models: Models) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Header and rows of the noise: stated and estimated for a film, fitted for an impact table."""
    data = result.data
    if isinstance(data, FilmData):
        film = data.film
        scale, units = np.array([1e3, 1e3, 180.0 / np.pi]), ("mm", "mm", "°")
        rows: list[tuple[str, ...]] = []
        for i, channel in enumerate(("x", "y", "angle")):
            sigmas = (film.stated_noise, film.noise, film.long_noise)
            stated, frame, averaged = (f"{v[i] * scale[i]:.3g}" for v in sigmas)
            ratio = film.noise[i] / film.stated_noise[i] if film.stated_noise[i] > 0 else 1.0
            remark = "" if 0.75 < ratio < 1.33 else f"{ratio:.2g} times what is stated"
            rows.append((f"{channel} ({units[i]})", stated, frame, averaged, remark))
        return ("1 sigma", "stated", "found", "found, in averages", ""), rows
    assert data is not None
    spread = np.diagonal(data.extra_scatter()[0])
    noise = models["base"].fit.scatter[-1 - len(spread) : -1] * spread
    names = ("along the ground (m/s)", "across it (m/s)", "spin (rad/s)")
    return ("1 sigma", "fitted"), [(name, f"{v:.3g}") for name, v in zip(names, noise, strict=True)]
