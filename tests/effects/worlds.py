"""Worlds that the tests of effects share."""

import numpy as np

from rock2d.effects import catalogue
from rock2d.engines.batch import run_batch, world_ensemble
from rock2d.engines.pymunk_engine import PymunkRelease
from rock2d.laws.contact import ContactParameters, contact_table
from rock2d.scene.cross_section import CrossSection
from rock2d.scene.world import World
from tests.laboratory import CUBE, LAW, SETUP, SLAB, SPHERE

FLOOR = CrossSection([[-50, 0], [50, 0]], ["floor"])
CATALOGUE = catalogue()
MECHANICAL = [name for name, effect in CATALOGUE.items() if not effect.camera]


def world(cross_section=SETUP, blocks=(SPHERE, CUBE, SLAB), law=LAW, **changes) -> World:
    """A world without effects."""
    contact = contact_table(law, cross_section.zone_names)[None]
    return World({b.name: b for b in blocks}, cross_section, contact, **changes)


def elastic(**changes) -> ContactParameters:
    """A law of springs alone: nothing that takes energy."""
    return ContactParameters(
        **{"k_ul_N_m": 1e4, "k_t_N_m": 0.0, "k_r_Nm_rad": 0.0, "friction_angle_deg": 0.0, **changes}
    )


def neutral(name: str) -> list[float]:
    return [p.neutral for p in CATALOGUE[name].parameters]


def typical(name: str, share: float = 0.4) -> list[float]:
    """Values of an effect a `share` of the way from neutral to the upper end of the plausible."""
    values = [p.neutral + share * (p.high - p.neutral) for p in CATALOGUE[name].parameters]
    if name == "slip_dependent_friction":
        values[1] = 1.0
    return values


def with_effect(base: World, name: str, values=None) -> World:
    return CATALOGUE[name].apply(base, typical(name) if values is None else values)


def falling(n: int, seed: int = 3) -> np.ndarray:
    """States that come down on ditch and facing of the set-up."""
    rng = np.random.default_rng(seed)
    return np.column_stack(
        [rng.normal(0.03, 0.03, n), rng.normal(0.12, 0.01, n), rng.uniform(0, 6.28, n),
         rng.normal(1.6, 0.2, n), rng.normal(-1.6, 0.2, n), rng.normal(-30, 15, n)]
    )  # fmt: skip


def run(w: World, states, block: int = 0, **options):
    """The batch engine on a world."""
    ensemble, tables = world_ensemble(w)
    ids = tables if len(tables) == len(np.atleast_2d(states)) else 0
    return run_batch(ensemble, states, block_ids=block, table_ids=ids, gravity_m_s2=w.gravity_m_s2, **options)


def pymunk_release(w: World, state, block: int = 0, **options) -> PymunkRelease:
    """A release of the pymunk engine on a world."""
    own = list(w.blocks.values())[block]
    return PymunkRelease(own, w.cross_section, w.contact[0], state, gravity_m_s2=w.gravity_m_s2, **options)


def energies(w: World, states, block: int = 0) -> np.ndarray:
    """Kinetic and potential energy in J of states (n, 6)."""
    own, q = list(w.blocks.values())[block], np.atleast_2d(states)
    kinetic = 0.5 * own.mass_kg * (q[:, 3] ** 2 + q[:, 4] ** 2) + 0.5 * own.inertia_kg_m2 * q[:, 5] ** 2
    return kinetic + own.mass_kg * w.gravity_m_s2 * q[:, 1]
