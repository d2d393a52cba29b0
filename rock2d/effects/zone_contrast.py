"""The embankment's soil, or that of its face alone, differs from the ditch's."""

from collections.abc import Sequence

import numpy as np

from rock2d.effects.changes import with_scaled_columns
from rock2d.effects.effect import Effect, Parameter
from rock2d.effects.fitted_effect import FittedEffect
from rock2d.laws.contact import K_L, K_UL, MU
from rock2d.scene.cross_section import embankment_facets, facet_zones, facing_facets
from rock2d.scene.world import World
from rock2d.wording import plain

EMBANKMENT, FACE = range(2)


def apply(world: World, values: Sequence[float]) -> World:
    """On the embankment or its face: k_l × stiffness, k_ul × stiffness / restitution², tan φ × friction; so
    e = √(k_l / k_ul) is multiplied by restitution. `values[3]` is a choice: 0 the embankment, 1 its face."""
    stiffness, restitution, friction, where = values
    facets = facing_facets if round(float(where)) == FACE else embankment_facets
    zones = facet_zones(world.cross_section, facets(world.cross_section))
    world = with_scaled_columns(world, (K_L,), stiffness, zones)
    world = with_scaled_columns(world, (K_UL,), stiffness / restitution**2, zones)
    world = with_scaled_columns(world, (MU,), friction, zones)
    world.contact[..., K_UL] = np.maximum(world.contact[..., K_UL], world.contact[..., K_L])
    return world


def remedy(fitted: FittedEffect) -> str:
    """Give the embankment, or its face, a soil of its own in the scenario."""
    stiffness, restitution, friction = (fitted.values[k] for k in ("stiffness", "restitution", "friction"))
    section, law = fitted.setup.cross_section, fitted.law
    where, facets = "embankment", embankment_facets
    if round(fitted.values["place"]) == FACE:
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


EFFECT = Effect(
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
            float(FACE),
            "where the soil differs (0 the embankment, 1 its face)",
            choices=(float(EMBANKMENT), float(FACE)),
            choice_names=("embankment", "face"),
        ),
    ),
    apply=apply,
    remedy=remedy,
)
