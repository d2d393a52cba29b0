"""Columns of effects in a contact row and in a block's `air`.

A contact row has the columns of `rock2d.laws.contact`, followed by those of the effects. 0 always means no effect, so a
row with only the columns of the law has no effects."""

import numpy as np

from rock2d.arrays import Array
from rock2d.effects import catalogue
from rock2d.laws.contact import CONTACT_LAW_COLUMNS

FIRST_EFFECT_COLUMN = len(CONTACT_LAW_COLUMNS)
_effects = catalogue().values()
# an effect with a law for flight has columns of the block, any other effect columns of the ground
CONTACT_NAMES = tuple(dict.fromkeys(c for e in _effects if e.flight is None for c in e.columns))
AIR_NAMES = tuple(dict.fromkeys(c for e in _effects if e.flight is not None for c in e.columns))
N_COLUMNS = FIRST_EFFECT_COLUMN + len(CONTACT_NAMES)
ANY_EFFECT_ACTS = N_COLUMNS  # column that `engine_rows` adds
N_AIR = len(AIR_NAMES)


def column(name: str) -> int:
    """Index of an effect's column in a contact row. Raises KeyError if no effect has it."""
    if name not in CONTACT_NAMES:
        raise KeyError(f"no effect has a contact column {name!r}; there are {', '.join(CONTACT_NAMES)}")
    return FIRST_EFFECT_COLUMN + CONTACT_NAMES.index(name)


# effects that act during a contact, and their columns
_laws = [e for e in _effects if any((e.normal, e.friction, e.tangential, e.recoil))]
_IN_CONTACT = sorted({column(name) for e in _laws for name in e.columns})


def air_column(name: str) -> int:
    """Index of an effect's column in `Block.air`. Raises KeyError if no effect has it."""
    if name not in AIR_NAMES:
        raise KeyError(f"no effect has an air column {name!r}; there are {', '.join(AIR_NAMES)}")
    return AIR_NAMES.index(name)


def widened(contact: Array) -> Array:
    """A copy of contact rows (..., columns) with every effect's column, 0 where the rows had none."""
    contact = np.asarray(contact, float)
    wide = np.zeros((*contact.shape[:-1], N_COLUMNS))
    wide[..., : contact.shape[-1]] = contact
    return wide


def engine_rows(contact: Array) -> Array:
    """Contact rows for the engines: with every effect's column, and a last column that is 1 if any effect acts in
    contact."""
    wide = widened(contact)
    acting = (wide[..., _IN_CONTACT] != 0.0).any(axis=-1, keepdims=True)
    return np.concatenate([wide, acting], axis=-1)


def damping_Ns_m(contact: Array) -> Array:
    """(..., zones) largest derivative of the effects' forces by the speed of a contact in N s/m. It limits the time
    steps of the engines, as the stiffness does."""
    total = np.zeros(contact.shape[:-1])
    for effect in _effects:
        if effect.damping is not None and contact.shape[-1] > FIRST_EFFECT_COLUMN:
            total += effect.damping(*(contact[..., column(name)] for name in effect.columns))
    return total
