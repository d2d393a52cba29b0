"""The built cross-section differs from the surveyed one: angle of the embankment's facing, level of the ditch; without
an embankment, slope and level of the ground."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rock2d.effects.effect import Effect, Parameter
from rock2d.effects.fitted_effect import FittedEffect
from rock2d.scene.cross_section import CrossSection, Embankment, ditch_before
from rock2d.scene.world import World
from rock2d.wording import number

STEEPEST_RAD = np.deg2rad(170.0)  # steepest facing; beyond the vertical it overhangs
CREST_LEFT = 0.1  # least share of the crest's width that remains with a flatter facing


def apply(world: World, values: Sequence[float]) -> World:
    """The points of the uphill facing turn about its foot by `facing_rad`; those of the ditch rise by `ditch_level`
    times the embankment's height. Without an embankment all ground turns, and rises by `ditch_level` times the
    blocks' size."""
    if not any(values):
        return world
    size = world.fitted_size_m
    return replace(world, cross_section=as_built(world.cross_section, float(values[0]), float(values[1]), size))


def as_built(cross_section: CrossSection, facing_rad: float, ditch_level: float, size_m: float) -> CrossSection:
    """The cross-section with the uphill facing turned about its foot by `facing_rad` (steeper if positive), its heights
    and the rest of the embankment kept, and the ditch's vertices raised by `ditch_level` × the embankment's height.

    The turn is a shear: a vertex at height h above the foot moves along x by h (cot α' - cot α). Of several embankments
    each facing is turned, and each ditch raised. Ground without an embankment is inclined as a whole about its middle
    and raised by `ditch_level` × `size_m`, the size of the blocks."""
    points = cross_section.points_m.copy()
    if not cross_section.embankments:
        middle = 0.5 * (points[0, 0] + points[-1, 0])
        points[:, 1] += ditch_level * size_m + np.tan(facing_rad) * (points[:, 0] - middle)
        return CrossSection(points, cross_section.zones, cross_section.measure_lines)
    for bank in cross_section.embankments:
        _turn(points, bank, facing_rad)
        ditch = np.arange(len(cross_section.zones))[ditch_before(cross_section, bank)]
        points[np.union1d(ditch, ditch + 1), 1] += ditch_level * bank.height_m
    return CrossSection(points, cross_section.zones, cross_section.measure_lines)


def _turn(points: np.ndarray, bank: Embankment, facing_rad: float) -> None:
    """Turn a facing about its foot, in place."""
    run, height = points[bank.crest] - points[bank.left]
    angle = np.clip(np.arctan2(height, run) + facing_rad, np.deg2rad(5.0), STEEPEST_RAD)
    shear = 1.0 / np.tan(angle) - run / height
    free_x = points[bank.crest_end, 0] if bank.crest_end > bank.crest else points[bank.right, 0]
    shear = min(shear, (1.0 - CREST_LEFT) * (free_x - points[bank.crest, 0]) / height)
    face = slice(bank.left + 1, bank.crest + 1)
    points[face, 0] += shear * (points[face, 1] - points[bank.left, 1])


def remedy(fitted: FittedEffect) -> str:
    """Survey again, with the fitted cross-section as expectation."""
    built = fitted.world().cross_section
    turn, width = np.rad2deg([fitted.values["facing_rad"], fitted.half["facing_rad"]])
    more, less = "steeper", "flatter"
    bank = fitted.setup.cross_section.embankment
    height = 1e3 * (bank.height_m if bank is not None else fitted.setup.mean_size_m)
    level, fine = height * fitted.values["ditch_level"], height * fitted.half["ditch_level"]
    what = "the facing", "the ditch"
    if bank is None:
        what, more, less = ("the ground", "it"), "turned, up to the right", "turned, down to the right"
    points = ", ".join(f"[{x:.4g}, {y:.4g}]" for x, y in built.points_m)
    return (
        f"Survey the cross-section again. Expected: {what[0]} is {number(abs(turn), width)}° "
        f"{more if turn > 0 else less} and {what[1]} lies {number(abs(level), fine)} mm "
        f"{'higher' if level > 0 else 'lower'} than stated. If the survey confirms it, set `points_m: [{points}]` in "
        "the cross-section and diagnose again."
    )


EFFECT = Effect(
    name="geometry_error",
    summary="the built cross-section differs from the surveyed one in the facing's angle and the ditch's level",
    source="geometry: facing and ditch are found by shape, `CrossSection.embankment`",
    phase="impact",
    origin="ground",
    parameters=(
        Parameter("facing_rad", "rad", 0.0, -0.2, 0.2, "turn of the uphill facing about its foot, or of all ground"),
        Parameter(
            "ditch_level",
            "1",
            0.0,
            -0.15,
            0.15,
            "rise of the ditch over the embankment's height, or of all ground over the blocks' size",
        ),
    ),
    apply=apply,
    remedy=remedy,
)
