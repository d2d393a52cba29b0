"""The next release: the one for which the two best explanations predict the most different outcomes."""

from collections.abc import Sequence

import numpy as np

from rock2d.arrays import Array
from rock2d.diagnosis.attribution import Attribution, Candidate
from rock2d.diagnosis.data import Data
from rock2d.diagnosis.gap import Cell
from rock2d.diagnosis.likelihood import chi_square
from rock2d.records.columns import LINEAR_VELOCITY, N_STATE, OMEGA
from rock2d.scene.world import World
from rock2d.wording import three_digits

FEWEST_IMPACTS_OF_A_KIND = 3  # smallest number of impacts for a proposal
# releases that differ from the filmed ones: text, factor on speed, spin added in √(g / radius)
POSSIBLE_RELEASES = (
    ("as filmed", 1.0, 0.0),
    ("1.5 times as fast", 1.5, 0.0),
    ("two thirds as fast", 0.67, 0.0),
    ("with more clockwise spin", 1.0, -1.0),
    ("with more counter-clockwise spin", 1.0, 1.0),
)


def next_release(
    data: Data, setup: World, attribution: Attribution, cells: Sequence[Cell], zones: Sequence[str]
) -> str:
    """A sentence: what to film next to separate the best effect from its closest rival."""
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
    candidates, explained = attribution.candidates, {attribution.strongest, *attribution.named}
    first = candidates.get(attribution.verdict, candidates[attribution.strongest])
    rivals = [c for name, c in candidates.items() if name not in explained and c is not first and not c.effect.scatter]
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
