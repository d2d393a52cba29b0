"""Effects of the ground: its geometry, its roughness and its soils differ from the stated ones, or it yields."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rock2d.compiled import kernel
from rock2d.effects.changes import with_column, with_scaled_columns
from rock2d.effects.effect import Effect, Parameter
from rock2d.effects.fitted_effect import FittedEffect
from rock2d.laws.contact import K_L, K_UL, MU
from rock2d.scene.cross_section import (
    CrossSection,
    Embankment,
    ditch_before,
    embankment_facets,
    facet_zones,
    facing_facets,
)
from rock2d.scene.world import World
from rock2d.wording import number, plain

STEEPEST_FACING_RAD = np.deg2rad(170.0)  # steepest facing; beyond the vertical it overhangs
LEAST_CREST_SHARE = 0.1  # least share of the crest's width that remains with a flatter facing


def with_geometry_error(world: World, values: Sequence[float]) -> World:
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
    angle = np.clip(np.arctan2(height, run) + facing_rad, np.deg2rad(5.0), STEEPEST_FACING_RAD)
    shear = 1.0 / np.tan(angle) - run / height
    free_x = points[bank.crest_end, 0] if bank.crest_end > bank.crest else points[bank.right, 0]
    shear = min(shear, (1.0 - LEAST_CREST_SHARE) * (free_x - points[bank.crest, 0]) / height)
    face = slice(bank.left + 1, bank.crest + 1)
    points[face, 0] += shear * (points[face, 1] - points[bank.left, 1])


def geometry_error_remedy(fitted: FittedEffect) -> str:
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


GEOMETRY_ERROR = Effect(
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
    apply=with_geometry_error,
    remedy=geometry_error_remedy,
)


def with_surface_roughness(world: World, values: Sequence[float]) -> World:
    """The normal of the ground turns by β from impact to impact, β normally distributed with mean 0 and standard
    deviation `sd_rad`. `values[0]` is one β for all releases, or one for each."""
    return replace(world, slope_rad=np.atleast_1d(np.asarray(values[0], float)))


def surface_roughness_remedy(fitted: FittedEffect) -> str:
    """Survey and level the surface."""
    slope = np.rad2deg(fitted.values["sd_rad"])
    return (
        "Survey the surface at distances of a block's size: a standard deviation of the slope of "
        f"{number(slope)}° is expected. If a profile of the ground was learnt, the surface is the same in every "
        "release: compare the curve with the survey. Else there is no mean to correct: level the surface before every "
        "release, or count the scatter as part of the soil and film more releases."
    )


SURFACE_ROUGHNESS = Effect(
    name="surface_roughness",
    summary="the local slope varies from impact to impact, or from place to place",
    source="random slope of the impact surface, as in Pfeiffer & Bowen (1989), Computer simulation of rockfalls",
    phase="impact",
    origin="ground",
    parameters=(Parameter("sd_rad", "rad", 0.0, 0.0, 0.3, "standard deviation of the local slope"),),
    apply=with_surface_roughness,
    remedy=surface_roughness_remedy,
    scatter=True,
)


EMBANKMENT, FACING = range(2)  # choices of the parameter `place`


def with_zone_contrast(world: World, values: Sequence[float]) -> World:
    """On the embankment or its face: k_l × stiffness, k_ul × stiffness / restitution², tan φ × friction; so
    e = √(k_l / k_ul) is multiplied by restitution. `values[3]` is a choice: 0 the embankment, 1 its face."""
    stiffness, restitution, friction, where = values
    facets = facing_facets if round(float(where)) == FACING else embankment_facets
    zones = facet_zones(world.cross_section, facets(world.cross_section))
    world = with_scaled_columns(world, (K_L,), stiffness, zones)
    world = with_scaled_columns(world, (K_UL,), stiffness / restitution**2, zones)
    world = with_scaled_columns(world, (MU,), friction, zones)
    world.contact[..., K_UL] = np.maximum(world.contact[..., K_UL], world.contact[..., K_L])
    return world


def zone_contrast_remedy(fitted: FittedEffect) -> str:
    """Give the embankment, or its face, a soil of its own in the scenario."""
    stiffness, restitution, friction = (fitted.values[k] for k in ("stiffness", "restitution", "friction"))
    section, law = fitted.setup.cross_section, fitted.law
    where, facets = "embankment", embankment_facets
    if round(fitted.values["place"]) == FACING:
        where, facets = "face of the embankment", facing_facets
    differ = facet_zones(section, facets(section))
    zones = ", ".join(f"`{name}`" for name, differs in zip(section.zone_names, differ, strict=True) if differs)
    k_l = law["k_l_N_m"] * stiffness
    k_ul = max(k_l, law["k_ul_N_m"] * stiffness / restitution**2)
    angle = np.rad2deg(np.arctan(np.tan(np.deg2rad(law["friction_angle_deg"])) * friction))
    return (
        f"Give the {where} its own soil in the scenario: `k_l_N_m: {plain(k_l)}`, `k_ul_N_m: {plain(k_ul)}`, "
        f"`friction_angle_deg: {angle:.3g}` for the zones {zones} under `deterministic`, and `k_l_N_m: "
        f"{plain(law['k_l_N_m'])}`, `k_ul_N_m: {plain(law['k_ul_N_m'])}`, `friction_angle_deg: "
        f"{law['friction_angle_deg']:.3g}` under `default`. To check, drop blocks vertically on both soils and "
        "compare the rebound."
    )


ZONE_CONTRAST = Effect(
    name="zone_contrast",
    summary="the embankment's soil differs from the ditch's in stiffness, restitution or friction",
    source="two soils for the paper's law (its Table 4 has one for both); restitution e = √(k_l / k_ul)",
    phase="impact",
    origin="ground",
    parameters=(
        Parameter("stiffness", "1", 1.0, 0.1, 10.0, "k_l of the embankment or its face over that of the other zones"),
        Parameter("restitution", "1", 1.0, 0.4, 2.5, "normal restitution there over that of the other zones"),
        Parameter("friction", "1", 1.0, 0.4, 2.5, "tan φ there over that of the other zones"),
        Parameter(
            "place",
            "choice",
            float(EMBANKMENT),
            float(EMBANKMENT),
            float(FACING),
            "where the soil differs (0 the embankment, 1 its face)",
            choices=(float(EMBANKMENT), float(FACING)),
            choice_names=("embankment", "face"),
        ),
    ),
    apply=with_zone_contrast,
    remedy=zone_contrast_remedy,
)


# k_t does not change: in the paper's law it regularises sticking and is not a property of the soil. So the stiffnesses
# of `zone_contrast` and `soil_compaction` differ only in where and when they change.


def with_soil_compaction(world: World, values: Sequence[float]) -> World:
    """k_l(n) = k_l (1 + rate m), k_ul(n) = k_ul (1 + rate m) (1 + excess m), m = (1 - exp(-saturation n)) / saturation:
    n is the number of earlier releases of the block; without saturation, m = n."""
    rate, excess, saturation = values
    order = np.asarray(world.order, float)
    acting = -np.expm1(-saturation * order) / saturation if saturation > 0.0 else order
    world = with_scaled_columns(world, (K_L, K_UL), 1.0 + rate * acting)
    world = with_scaled_columns(world, (K_UL,), np.maximum(1.0 + excess * acting, 0.05))
    world.contact[..., K_UL] = np.maximum(world.contact[..., K_UL], world.contact[..., K_L])
    return world


def soil_compaction_remedy(fitted: FittedEffect) -> str:
    """Loosen the soil before every release."""
    return (
        f"The stiffness grows by {fitted.number('rate', 100)} % of its first value with the first release of the same "
        "block, and less with later ones. Loosen and level the soil before every release, and film the blocks in "
        "random order. To check, repeat the first release at the end of the series: it should rebound differently."
    )


SOIL_COMPACTION = Effect(
    name="soil_compaction",
    summary="the soil stiffens from release to release, as blows compact it",
    source="stiffness that grows with the number of blows towards that of the densest state",
    phase="impact",
    origin="ground",
    grows=True,
    parameters=(
        Parameter("rate", "1", 0.0, 0.0, 0.45, "growth of k_l and k_ul with the first release of the same block"),
        Parameter("excess", "1", 0.0, -0.03, 0.03, "growth of k_ul / k_l with the first release of the same block"),
        Parameter("saturation", "1", 0.0, 0.0, 0.45, "share by which each release slows the growth", optional=True),
    ),
    apply=with_soil_compaction,
    remedy=soil_compaction_remedy,
)


# friction of the embankment on its base, which holds it under a block that rolls or lies on it: soil on a firm ground
BASE_FRICTION = 0.5
# damping ratio of the horizontal motion on an elastic base: 0.29 / √B with a mass ratio B of about 1, after Richart,
# Hall & Woods (1970), Vibrations of soils and foundations
BASE_DAMPING_RATIO = 0.3


@kernel
def embankment_recoil(per_mass, held_m_s2, rate_1_s, force, shift, speed):
    """Acceleration in m/s² of the block in the frame of an embankment of mass M, in addition to that by the force F_x
    on the block. The embankment slides on its base: F_x / M beyond the friction, which can hold `held_m_s2` × M. Or,
    with a natural frequency ω = `rate_1_s`, it moves on a spring with a dashpot: F_x / M + ω² `shift` + 2 D ω `speed`.

    At the end of the impact the embankment stops, and stays where it is until the release ends."""
    if rate_1_s > 0.0:
        return force * per_mass + rate_1_s * (rate_1_s * shift + 2.0 * BASE_DAMPING_RATIO * speed)
    sliding = abs(force) * per_mass - held_m_s2
    return np.copysign(sliding, force) if sliding > 0.0 else 0.0


def with_embankment_yield(world: World, values: Sequence[float]) -> World:
    """The embankment is a body of the blocks' mean mass over `values[0]`. It slides on its base, or is held by
    `values[1]` × k_l."""
    mass_ratio, base_stiffness = values
    zones = facet_zones(world.cross_section, embankment_facets(world.cross_section))
    per_kg = mass_ratio / world.fitted_mass_kg
    rate_1_s = np.sqrt(base_stiffness * world.contact[..., K_L] * per_kg)
    held_m_s2 = BASE_FRICTION * world.gravity_m_s2 if mass_ratio > 0.0 and not base_stiffness else 0.0
    moving = with_column(world, "recoil_1_kg", per_kg, zones)
    moving = with_column(moving, "recoil_held_m_s2", held_m_s2, zones)
    return with_column(moving, "recoil_rate_1_s", rate_1_s, zones)


def embankment_yield_remedy(fitted: FittedEffect) -> str:
    """Check whether the embankment moves, with its moving mass."""
    moving = fitted.setup.fitted_mass_kg / max(fitted.values["mass_ratio"], 1e-9)
    base = fitted.values["base_stiffness"] * fitted.law["k_l_N_m"]
    how = f" on a base of {number(base)} N/m" if base else " that slides"
    return (
        f"Look whether the embankment moves: film a mark on its crest. A moving mass of {number(moving)} kg{how} is "
        "expected. Fix the embankment to its base and film again, or weigh it and state that it moves."
    )


EMBANKMENT_YIELD = Effect(
    name="embankment_yield",
    summary="the embankment moves on its base as a body during an impact",
    source="two bodies in impact: head-on, e is (e M - m) / (M + m) of a block of mass m",
    phase="impact",
    origin="ground",
    parameters=(
        Parameter("mass_ratio", "1", 0.0, 0.0, 0.6, "blocks' mean mass over the mass of the embankment that moves"),
        Parameter(
            "base_stiffness",
            "1",
            0.0,
            0.0,
            10.0,
            "horizontal stiffness of the base over k_l of the embankment; 0: it slides on its base",
            optional=True,
        ),
    ),
    apply=with_embankment_yield,
    remedy=embankment_yield_remedy,
    columns=("recoil_1_kg", "recoil_held_m_s2", "recoil_rate_1_s"),
    recoil=embankment_recoil,
)


EFFECTS = (GEOMETRY_ERROR, SURFACE_ROUGHNESS, ZONE_CONTRAST, SOIL_COMPACTION, EMBANKMENT_YIELD)
