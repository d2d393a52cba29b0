"""The data of a fit (measured segments), and the residuals of a model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from rock2d.scene.world import World

Array = np.ndarray


@dataclass
class Residuals:
    """Impacts (n, d) in SI; flights (m, 3, degrees) in units of noise. NaN where an impact cannot be simulated.

    d = 6 on film: along the ground and across it (m) and angle (rad), then their rates; in an impact table the rates
    alone.
    """

    impacts: Array
    flights: Array


class Data(Protocol):
    """Measured segments that models are fitted to: `film_data.FilmData` or `impact_table_data.TableData`."""

    order: Array  # (releases,) place of each release in its block's series

    @property
    def impact_release(self) -> Array:
        """(n,) release of each impact."""

    @property
    def flight_release(self) -> Array:
        """(m,) release of each flight."""

    @property
    def flight_block(self) -> Array:
        """(m,) block of each flight."""

    @property
    def impact_order(self) -> Array:
        """(n,) place of each impact's release in its series."""

    @property
    def impact_block(self) -> Array:
        """(n,) block of each impact."""

    @property
    def impact_zone(self) -> Array:
        """(n,) zone of each impact."""

    @property
    def tangent(self) -> Array:
        """(n, 2) direction of the ground at each impact."""

    def only(self, releases: Array) -> Data:
        """The segments of some of the releases, given as a mask; releases keep their numbers."""

    def coarse(self) -> Data:
        """The same, but impacts are simulated in fewer steps: for a first look."""

    def residuals(self, world: World, shift: Array | None = None) -> Residuals:
        """Residuals in a world; `shift` (6,) or (n, 6) is added to the states before the impacts."""

    def incident(self, world: World) -> Array:
        """(n, 6) states before the impacts."""

    def state_noise(self, world: World) -> Array:
        """(n, 6, 6) covariance of the states before the impacts, in that world."""

    def outcome_noise(self) -> Array:
        """(n, d, d) covariance of the residuals of impacts from the measurement after them."""

    def extra_scatter(self) -> Array:
        """(n, d, k) directions of noise whose size is fitted together with the soil's scatter."""

    def impact_features(self, world: World) -> Array:
        """(n, features) of each impact, known before it happens."""

    def impact_quantities(self, world: World) -> dict[str, Array]:
        """Name -> (n,): what an impact may depend on, see `quantities`."""

    def outcome_quantities(self, world: World) -> dict[str, Array]:
        """The same of the motion after the impacts, as far as it is known then."""

    def flight_features(self, world: World) -> Array:
        """(m, features) of each flight."""
