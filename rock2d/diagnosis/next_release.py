"""Which release would best tell two explanations apart: the one whose outcome they predict most differently."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rock2d.diagnosis.attribution import Attribution
from rock2d.diagnosis.candidate import Candidate
from rock2d.diagnosis.data import Data
from rock2d.diagnosis.gap import Cell
from rock2d.scene.world import World

Array = np.ndarray

FEWEST_IMPACTS_OF_A_KIND = 3  # impacts of a kind below which it is not proposed
# releases that differ from the filmed ones: in words, factor on speed, spin added in √(g / size)
VARIANTS = (
    ("as filmed", 1.0, 0.0),
    ("half as fast again", 1.5, 0.0),
    ("two thirds as fast", 0.67, 0.0),
    ("with more clockwise spin", 1.0, -1.0),
    ("with more counter-clockwise spin", 1.0, 1.0),
)


def next_release(
    data: Data, setup: World, found: Attribution, cells: Sequence[Cell], zones: Sequence[str]
) -> str:
    """In words: what to film next to split the best effect from its closest rival."""
    if found.verdict == "unknown":
        if not cells:
            return "More releases of every block: what is there cannot be told from noise yet."
        cell = cells[0]
        return (
            f"More releases that show {_place(cell)}: most of the gap lies there, "
            "and nothing in the catalogue explains it."
        )
    first = found.candidates[found.best]
    rivals = [c for c in found.candidates.values() if c is not first and not c.effect.scatter]
    if not rivals or first.effect.scatter:
        return "More releases of every block: a scatter is told from a shift by their number."
    second = max(rivals, key=lambda c: c.total)
    names = f"{first.effect.name} and {second.effect.name}"
    best, words = 0.0, ""
    for text, faster, spin in VARIANTS:
        distance = _distance(data, setup, first, second, faster, spin)
        for block in range(len(setup.blocks)):
            for zone in range(len(zones)):
                own = (data.impact_block == block) & (data.impact_zone == zone) & np.isfinite(distance)
                if (
                    own.sum() >= FEWEST_IMPACTS_OF_A_KIND
                    and (typical := float(np.median(distance[own]))) > best
                ):
                    pace = float(np.median(np.hypot(*data.incident(setup)[own, 3:5].T))) * faster
                    best = typical
                    words = f"a {list(setup.blocks)[block]} that strikes the {zones[zone]} at {pace:.2g} m/s ({text})"
    if not words:
        return f"Longer flights: no impact tells {names} apart."
    lead = "" if found.verdict != "none" else "No effect stands out. "
    return f"{lead}{words[0].upper()}{words[1:]}: there {names} differ by {best:.2g} standard deviations in one impact."


def _place(cell: Cell) -> str:
    if cell.phase == "flight":
        return f"flights of the {cell.block} above the {cell.zone}"
    return f"impacts of the {cell.block} on the {cell.zone}"


def _distance(
    data: Data, setup: World, first: Candidate, second: Candidate, faster: float, spin: float
) -> Array:
    """(n,) standard deviations between what two models predict of each impact."""
    size = np.array([b.radius_m for b in setup.blocks.values()])[data.impact_block]
    shift = np.zeros((len(size), 6))
    shift[:, 3:5] = (faster - 1.0) * data.incident(setup)[:, 3:5]
    shift[:, 5] = spin * np.sqrt(setup.gravity_m_s2 / size)
    residuals = [
        data.residuals(c.fit.model.world(c.fit.p, data.impact_order), shift).impacts for c in (first, second)
    ]
    difference = np.nan_to_num(residuals[0] - residuals[1])
    covariance = first.fit.covariance()
    chi2 = np.einsum("ni,ni->n", difference, np.linalg.solve(covariance, difference[..., None])[..., 0])
    finite = np.isfinite(residuals[0]).all(axis=1) & np.isfinite(residuals[1]).all(axis=1)
    return np.where(finite, np.sqrt(np.maximum(chi2, 0.0)), np.nan)
