"""Which column of a contact row, or of a block's `air`, belongs to which effect.

A row of the contact law has the columns of `rock2d.laws.contact` and then those that effects ask for. 0 is always the
world without the effect, so a table of the law's own columns means no effect.
"""

from __future__ import annotations

import numpy as np

from rock2d.effects import catalogue

Array = np.ndarray

LAW_COLUMNS = 7
_effects = catalogue().values()
# an effect with a law for the flight reads columns of the block, any other one columns of the ground
CONTACT_NAMES = tuple(dict.fromkeys(c for e in _effects if e.flight is None for c in e.columns))
AIR_NAMES = tuple(dict.fromkeys(c for e in _effects if e.flight is not None for c in e.columns))
N_COLUMNS = LAW_COLUMNS + len(CONTACT_NAMES)
N_AIR = len(AIR_NAMES)


def column(name: str) -> int:
    """Index of an effect's column in a contact row. Raises KeyError if no effect has it."""
    if name not in CONTACT_NAMES:
        raise KeyError(f"no effect has a contact column {name!r}; there are {', '.join(CONTACT_NAMES)}")
    return LAW_COLUMNS + CONTACT_NAMES.index(name)


def air_column(name: str) -> int:
    """Index of an effect's column in `Block.air`. Raises KeyError if no effect has it."""
    if name not in AIR_NAMES:
        raise KeyError(f"no effect has an air column {name!r}; there are {', '.join(AIR_NAMES)}")
    return AIR_NAMES.index(name)


def _acting() -> list[int]:
    """Columns of the effects that act while a contact lasts."""
    laws = [e for e in _effects if any((e.normal, e.friction, e.tangential, e.recoil))]
    return sorted({column(name) for e in laws for name in e.columns})


def widened(contact: Array) -> Array:
    """A copy of contact rows (..., columns) with every effect's column, 0 where the rows had none."""
    contact = np.asarray(contact, float)
    wide = np.zeros((*contact.shape[:-1], N_COLUMNS))
    wide[..., : contact.shape[-1]] = contact
    return wide


def engine_rows(contact: Array) -> Array:
    """Contact rows as the engines read them: every effect's column, and last whether any of them acts in contact."""
    wide = widened(contact)
    acting = (wide[..., _ACTING] != 0.0).any(axis=-1, keepdims=True)
    return np.concatenate([wide, acting], axis=-1)


def damping_Ns_m(contact: Array) -> Array:
    """(..., zones) by how much the effects' forces in N grow with the speed of a contact in m/s, at most: what limits
    the engines' steps beside the stiffness."""
    total = np.zeros(contact.shape[:-1])
    for effect in _effects:
        if effect.damping is not None and contact.shape[-1] > LAW_COLUMNS:
            total += effect.damping(*(contact[..., column(name)] for name in effect.columns))
    return total


_ACTING = _acting()
