"""Which effects these data can show at all: those with which some residual changes by more than a trace of its noise.

Flights alone show nothing of impacts, a table of impacts nothing of the air, a ball without marks nothing of its spin.
Such effects are not tried: of them nothing is known but that they are possible.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from rock2d.diagnosis.data import Data, Residuals
from rock2d.diagnosis.film_data import FilmData
from rock2d.diagnosis.fitting import Fit, some_releases
from rock2d.diagnosis.model import BASE_WIDTH, Model
from rock2d.effects.effect import FLIGHT, Effect

Array = np.ndarray

# effects that differ from another one only in the spin
SPIN_TWINS = {"flight_damping": "air_drag"}
TRACE = 0.05  # of a standard deviation, by which no residual changes


def unseen(base: Fit, data: Data, effects: Mapping[str, Effect]) -> dict[str, str]:
    """Effect that these data cannot show -> why."""
    some = some_releases(data)
    part = base.only(some[data.impact_release], some[data.flight_release])
    own = data.only(some).coarse()
    at = base.model.residuals(base.p, own)
    sd = np.sqrt(np.diagonal(part.covariance(), axis1=1, axis2=2))
    why, found = _why(data), dict[str, str]()
    if isinstance(data, FilmData) and not data.film.angle_known.any():
        found = {
            name: f"without the spin it cannot be told from {twin}"
            for name, twin in SPIN_TWINS.items()
            if {name, twin} <= effects.keys()
        }
    return found | {
        name: why[effect.origin == FLIGHT or effect.phase != "impact"]
        for name, effect in effects.items()
        if name not in found and not _shows(replace(base.model, effects=[effect]), base.p, own, at, sd)
    }


def _why(data: Data) -> dict[bool, str]:
    """Why what acts in flight (True), and what acts in impacts only (False), is not seen."""
    nothing = "nothing that was measured changes with it"
    in_flight = nothing if len(data.flight_release) else "no flight was recorded"
    if isinstance(data, FilmData) and not data.film.angle_known.any():
        in_flight = "the spin was not measured"
    return {True: in_flight, False: nothing if len(data.impact_release) else "no impact can be judged"}


def _shows(model: Model, p: Array, data: Data, at: Residuals, sd: Array) -> bool:
    """Whether some residual changes between no effect and one at the ends of its plausible range."""
    parameters = model.parameters[0]
    start = np.concatenate([p, model.start()[len(BASE_WIDTH) :]])
    for k, q in enumerate(parameters):
        for value in q.choices or (q.low, q.high):
            amounts = [[value if i == k else v for i, v in enumerate(model.values(start)[0])]]
            ahead = model.residuals(start, data, amounts=amounts)
            changes = ((ahead.impacts - at.impacts) / sd, ahead.flights - at.flights)
            if any(np.abs(c).max(initial=0.0) > TRACE or np.isnan(c).any() for c in changes):
                return True
    return False
