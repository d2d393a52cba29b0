"""Fitted parameters as a report shows them: value, 95 % interval, and whether the data determine it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rock2d.diagnosis.data import FilmData
from rock2d.diagnosis.diagnose import Diagnosis
from rock2d.diagnosis.diagnosis_content import effect_values
from rock2d.diagnosis.fitting import Fit
from rock2d.diagnosis.model import BASE_K_L, BASE_MU, BASE_RATIO, BASE_WIDTH
from rock2d.diagnosis.report.tables import Models
from rock2d.diagnosis.report.text import in_degrees
from rock2d.wording import interval, number, spoken

Array = np.ndarray

UNDETERMINED_WIDTH = 0.7  # share of the prior's width: a parameter with a wider interval is undetermined
EDGE_DISTANCE = 0.01  # share of the plausible range; a parameter nearer to an end is at the end
LAW = (
    ("k<sub>l</sub>", "loading stiffness", "N/m"),
    ("k<sub>ul</sub>", "unloading stiffness", "N/m"),
    ("k<sub>t</sub>", "tangential stiffness", "N/m"),
    ("φ", "friction angle", "°"),
    ("k<sub>r</sub>", "rolling stiffness", "N m/rad"),
)
SCATTER = ("k<sub>l</sub>", "k<sub>ul</sub> / k<sub>l</sub>", "k<sub>t</sub>", "tan φ", "k<sub>r</sub>")
UNDETERMINED_TEXT = "not determined by these data"


@dataclass(frozen=True)
class Value:
    """A number as text, with its interval or another text in its place."""

    text: str
    interval: str


@dataclass(frozen=True)
class LawRow:
    """A parameter of the base law; `values`: model -> value."""

    symbol: str
    meaning: str
    unit: str
    values: dict[str, Value]


@dataclass(frozen=True)
class EffectRow:
    """A parameter of an effect."""

    effect: str
    meaning: str
    unit: str
    value: Value
    plausible: str
    remark: str


def law_rows(models: Models) -> list[LawRow]:
    """The base law's five parameters, alone and with the effect."""
    values = {name: _law_values(fit) for name, fit in models.fits.items()}
    return [LawRow(*LAW[i], {name: own[i] for name, own in values.items()}) for i in range(len(LAW))]


def _law_values(fit: Fit) -> list[Value]:
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
        text = number(float(value), None if undetermined[i] else 0.5 * float(high - low))
        out.append(Value(text, UNDETERMINED_TEXT if undetermined[i] else interval(float(low), float(high))))
    return out


def scatter_rows(models: Models) -> list[tuple[str, dict[str, str]]]:
    """Symbol of each parameter, and model -> its scatter from impact to impact (1 sigma) in %."""
    return [
        (symbol, {name: f"{100 * fit.scatter[i]:.2g} %" for name, fit in models.fits.items()})
        for i, symbol in enumerate(SCATTER)
    ]


def effect_rows(models: Models) -> list[EffectRow]:
    """Parameters of the effects in the model."""
    if (fit := models.fits.get("effect")) is None:
        return []
    rows, model, values = [], fit.model, effect_values(fit)
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
            least, most = (in_degrees(parameter, v)[0] for v in (parameter.low, parameter.high))
            if parameter.choices:
                shown, plausible = Value(parameter.called(value) or number(value), ""), ""
            else:
                shown = Value(number(value, 0.5 * (high - low)), interval(low, high) if high > low else "")
                plausible = f"{least:.3g} to {most:.3g}".replace("-", "−")
                if high - low > UNDETERMINED_WIDTH * 1.96 * (most - least):
                    remark = UNDETERMINED_TEXT
                elif (
                    min(value - least, most - value) < EDGE_DISTANCE * (most - least)
                    and value != parameter.neutral
                ):
                    remark = "at the end of its plausible range"
            rows.append(EffectRow(effect.name, meaning, unit, shown, plausible, remark))
    return rows


def noise_rows(result: Diagnosis, models: Models) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
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
    noise = models.fits["base"].scatter[-len(spread) :] * spread
    names = ("along the ground (m/s)", "across it (m/s)", "spin (rad/s)")
    return ("1 sigma", "fitted"), [(name, f"{v:.3g}") for name, v in zip(names, noise, strict=True)]
