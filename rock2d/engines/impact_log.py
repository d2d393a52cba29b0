"""Impacts of a run of the pymunk engine, from its knots."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from rock2d.engines.recording import LEAST_PRESSURE, depart
from rock2d.records.columns import INSTANT_NAMES, STATE_NAMES, after


class Departure(NamedTuple):
    """What effects make of the velocities at the end of an impact: its zone's parameters, and the velocity in m/s that
    recoiling ground gave it."""

    row: np.ndarray
    recoil: float


class Knot(NamedTuple):
    """State at one instant; sum of normal forces and largest penetration of the active contacts; where an impact has
    just ended, how the block departs."""

    time: float
    q: np.ndarray
    active: int = 0
    force: float = 0.0
    depth: float = 0.0
    departure: Departure | None = None


class ImpactLog:
    """Divides the knots of a run into impacts.

    An impact begins at the first touch and ends when the ground last presses before the block is clear of it
    (not when it has climbed out of its own indentation: gravity acts meanwhile, the law does not).
    """

    def __init__(self, first_zone: Callable[[], str]) -> None:
        """`first_zone` gives the zone of the first active contact."""
        self._first_zone = first_zone
        self.impacts: list[dict[str, Any]] = []
        self.open: dict[str, Any] | None = None
        self._left: Knot | None = None  # where the ground stopped pressing, unless it presses again

    def add(self, knot: Knot) -> None:
        """Take the next knot of the run."""
        if self.open is None:
            if knot.active:
                self.open = {"zone": self._first_zone(), "t_s": knot.time}
                self.open.update(zip(STATE_NAMES, map(float, knot.q), strict=True))
                self.open.update(penetration_m=0.0, force_N=0.0)
                self._left = None
            return
        self.open["penetration_m"] = max(self.open["penetration_m"], knot.depth)
        self.open["force_N"] = max(self.open["force_N"], knot.force)
        if knot.force > LEAST_PRESSURE * self.open["force_N"]:
            self._left = None
        elif self._left is None:
            self._left = knot
        if not knot.active:
            self._end(self._left, knot.departure)

    def close(self) -> None:
        """The run is over: an impact that still presses has no state after."""
        if self.open is not None:
            self._end(self._left, None)

    def _end(self, knot: Knot | None, departure: Departure | None) -> None:
        assert self.open is not None
        if knot is not None and departure is not None:
            state = knot.q.copy()
            depart(state, *departure)
            knot = knot._replace(q=state)
        values = [np.nan] * len(INSTANT_NAMES) if knot is None else [knot.time, *map(float, knot.q)]
        self.open.update(zip(map(after, INSTANT_NAMES), values, strict=True))
        self.impacts.append(self.open)
        self.open = None
