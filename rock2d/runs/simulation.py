"""Simulated releases, and `simulate`, which simulates releases without a scenario file."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rock2d.arrays import Array
from rock2d.errors import InputError, UnusualWarning, comma_list, counted
from rock2d.records.columns import STATE_NAMES
from rock2d.records.track import Track
from rock2d.registry import registered
from rock2d.runs.engines import Condition, engine_named
from rock2d.runs.incident_states import IncidentState, drawn_seeds
from rock2d.runs.recording import Recording, trajectories_table
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection, site_time_limit_s
from rock2d.scene.plausibility import contact_doubts, highest_speed_m_s

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from rock2d.graphics.canvas import Limits
    from rock2d.laws.contact import ContactParameters
    from rock2d.laws.rebound import ReboundParameters

TRAJECTORIES = "trajectories"


class Indicator(NamedTuple):
    """A table of a run.

    Attributes
    ----------
    name : name of the table and of its CSV file
    columns : names of the columns with units; a table may have further columns after them
    table : computes the table
    applies : whether these releases have such a table"""

    name: str
    columns: tuple[str, ...]
    table: Callable[[Simulation], pd.DataFrame]
    applies: Callable[[Simulation], bool] = lambda run: True


def indicators() -> Mapping[str, Indicator]:
    """Every indicator by its name, in the order of the names. Raises ValueError if two share a name."""
    return registered("rock2d.runs.indicators", "INDICATOR")


@dataclass(repr=False)
class Simulation:
    """Simulated releases of one or several blocks on one cross-section.

    Attributes
    ----------
    engine : name of the engine
    cross_section : the ground
    blocks : name -> block
    tracks : the motion of each release, in the order of the releases
    recording : how `to_pandas("trajectories")` samples the tracks
    title : title of plots
    own_blocks : release -> its block, if blocks differ from release to release"""

    engine: str
    cross_section: CrossSection
    blocks: Mapping[str, Block]
    tracks: list[Track]
    recording: Recording = field(default_factory=Recording)
    title: str = ""
    own_blocks: Mapping[int, Block] = field(default_factory=dict)
    _tables: dict[str, pd.DataFrame] = field(default_factory=dict, repr=False, compare=False)

    def table_names(self) -> tuple[str, ...]:
        """Names of the tables that `to_pandas` can return for these releases."""
        return (TRAJECTORIES, *(name for name, indicator in indicators().items() if indicator.applies(self)))

    def to_pandas(self, table: str = TRAJECTORIES) -> pd.DataFrame:
        """A table of these releases, with units in the names of its columns.

        Parameters
        ----------
        table : {"trajectories", "impacts", "crossings", "passing", "percentiles", "stops", "energy"} or the name of
            another indicator.
            "trajectories" samples the tracks like a camera; "impacts" and "crossings" are exact. "passing" and
            "percentiles" summarize the crossings of the measure lines. "energy" is the energy audit.

        Returns
        -------
        pandas.DataFrame
            A copy, which the caller may change.

        Raises
        ------
        InputError
            Code ``unknown_name`` if there is no such table for these releases."""
        if table not in self.table_names():
            known = ", ".join(self.table_names())
            raise InputError(f"unknown table {table!r}, expected one of {known}", code="unknown_name", name=table)
        if table not in self._tables:
            self._tables[table] = (
                trajectories_table(self.tracks, self.recording, self.block_of)
                if table == TRAJECTORIES
                else indicators()[table].table(self)
            )
        return self._tables[table].copy()

    def block_of(self, track: Track) -> Block:
        """The block of a release."""
        return self.own_blocks.get(track.release) or self.blocks[track.block]

    def plot(self) -> Figure:
        """The cross-section and the path of every release, with one panel for each block.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        InputError
            If there is no release."""
        from rock2d.graphics.trajectories import trajectories_figure

        return trajectories_figure(*self.drawn_paths(self.title))

    def drawn_paths(self, title: str, window: Limits | None = None) -> tuple[Any, ...]:
        """Arguments of `trajectories_figure` for these releases, without the tracks that it does not draw."""
        from rock2d.graphics.trajectories import shown_tracks

        shown, releases = shown_tracks(self.tracks)
        return self.cross_section, dict(self.blocks), shown, title, window, releases

    def __repr__(self) -> str:
        count = Counter(track.block for track in self.tracks)
        return (
            f"<{type(self).__name__} {self.title}: {counted(len(self.tracks), 'release')}, engine {self.engine}\n"
            f" blocks: {comma_list(f'{name} ({n})' for name, n in count.items())}\n"
            f" tables: {', '.join(self.table_names())}>"
        )

    def _repr_html_(self) -> str:
        from rock2d.graphics.pages import notebook_figure, notebook_table

        stops = self.to_pandas("stops").groupby("block", sort=False)
        summary = stops.agg(releases=("release", "size"), runout_m=("runout_m", "median"))
        summary["stops"] = stops["stop"].agg(lambda stop: ", ".join(f"{n} {s}" for s, n in stop.value_counts().items()))
        summary = summary.rename(columns={"runout_m": "median runout_m"})
        return notebook_table(summary.reset_index()) + notebook_figure(self.plot())


def simulate(
    block: Block,
    cross_section: CrossSection,
    parameters: ContactParameters | ReboundParameters | Mapping[str, Any],
    states: Sequence[float] | Sequence[Sequence[float]] | Array,
    *,
    engine: str = "pymunk",
    gravity_m_s2: float = 9.81,
    time_limit_s: float | None = None,
    seed: int = 0,
) -> Simulation:
    """Simulate releases of one block from given states, without a scenario file.

    Parameters
    ----------
    block : Block
        See `make_block`.
    cross_section : CrossSection
        The ground.
    parameters : ContactParameters, ReboundParameters or mapping of zone names to one of them
        `ContactParameters` for the engines "pymunk" and "batch", `ReboundParameters` for "point_mass". The key
        "default" of a mapping holds for the zones that it does not name.
    states : (6,) or (n, 6) array
        x_m, y_m, theta_rad, vx_m_s, vy_m_s, omega_rad_s of the centre of mass at t = 0, one row for each release.
    engine : {"pymunk", "batch", "point_mass"}
    gravity_m_s2 : float
    time_limit_s : float, optional
        A release ends after this time at the latest. The default follows from the size of the cross-section, see
        `rock2d.scene.cross_section.site_time_limit_s`.
    seed : int
        Seed of the random numbers of the rebound law.

    Returns
    -------
    Simulation
        Tracks, tables and plots of the releases.

    Raises
    ------
    InputError
        Code ``unknown_name`` for an engine that does not exist, ``wrong_kind`` for parameters of the other law,
        ``bad_value`` for states that are not rows of six finite numbers.
    ValueError
        If a zone has no parameters, or there is neither gravity nor a time limit.

    Warns
    -----
    UnusualWarning
        If the penetration of the block at the highest speed that the site allows is unusually large or small.

    Examples
    --------
    >>> import rock2d
    >>> ball = rock2d.make_block("ball", "circle", mass_kg=0.022, diameter_m=0.025)
    >>> floor = rock2d.CrossSection([[-1, 0], [2, 0]], ["floor"])
    >>> states = [[0, 0.2, 0, 0.5, 0, 0], [0, 0.3, 0, 0.5, 0, 0]]
    >>> result = rock2d.simulate(ball, floor, rock2d.ContactParameters(), states)
    >>> result.to_pandas("stops")["stop"].tolist()
    ['rest', 'rest']"""
    from rock2d.laws.contact import contact_table

    chosen = engine_named(engine)
    by_zone = _by_zone(parameters, chosen.law, engine)
    rows = np.atleast_2d(np.asarray(states, float))
    if rows.ndim != 2 or rows.shape[1:] != (len(STATE_NAMES),) or not np.isfinite(rows).all():
        raise InputError(f"states must be rows of six finite numbers: {', '.join(STATE_NAMES)}")
    deterministic = chosen.law == "deterministic"
    if deterministic and len(rows):
        stiffness = {zone: law.k_l_N_m for zone, law in by_zone.items()}
        for doubt in contact_doubts(block, stiffness, highest_speed_m_s(rows, cross_section, gravity_m_s2)):
            warnings.warn(UnusualWarning(doubt.text), stacklevel=2)
    seeds = drawn_seeds(seed, 0, 0, len(rows)) if len(rows) else ()
    limit = site_time_limit_s(cross_section, gravity_m_s2) if time_limit_s is None else time_limit_s
    law = contact_table(by_zone, cross_section.zone_names) if deterministic else by_zone
    condition = Condition(block, cross_section, law, {})
    tracks = [
        chosen.track(condition, IncidentState(release, block.name, 0.0, state, int(own_seed)), gravity_m_s2, limit)
        for release, (state, own_seed) in enumerate(zip(rows, seeds, strict=True))
    ]
    return Simulation(engine, cross_section, {block.name: block}, tracks, title=f"{block.name} ({engine})")


def _by_zone(parameters: Any, law: str, engine: str) -> Mapping[str, Any]:
    from rock2d.laws.contact import ContactParameters
    from rock2d.laws.rebound import ReboundParameters

    kind = {"deterministic": ContactParameters, "probabilistic": ReboundParameters}[law]
    by_zone = parameters if isinstance(parameters, Mapping) else {"default": parameters}
    for zone, given in by_zone.items():
        if not isinstance(given, kind):
            message = f"engine {engine} takes {kind.__name__}, zone {zone!r} has {type(given).__name__}"
            raise InputError(message, code="wrong_kind", zone=zone)
    return by_zone
