"""An indicator: a named table that is computed from the tracks of a run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple, Protocol

if TYPE_CHECKING:
    import pandas as pd

    from rock2d.records.track import Track
    from rock2d.scene.blocks import Block
    from rock2d.scene.cross_section import CrossSection


class Simulated(Protocol):
    """Simulated releases as indicators read them."""

    @property
    def tracks(self) -> Sequence[Track]:
        """The tracks in the order of the releases."""

    @property
    def cross_section(self) -> CrossSection:
        """The ground."""

    @property
    def blocks(self) -> Mapping[str, Block]:
        """Name -> block."""

    @property
    def own_blocks(self) -> Mapping[int, Block]:
        """Release -> its block, if blocks differ from release to release."""

    def block_of(self, track: Track) -> Block:
        """The block of a release."""

    @property
    def engine(self) -> str:
        """Name of the engine."""

    def to_pandas(self, table: str) -> pd.DataFrame:
        """Another table of the same releases."""


def _always(run: Simulated) -> bool:
    return True


class Indicator(NamedTuple):
    """A table of a run.

    Attributes
    ----------
    name : name of the table and of its CSV file
    columns : names of the columns with units; a table may have further columns after them
    table : computes the table
    applies : whether these releases have such a table
    """

    name: str
    columns: tuple[str, ...]
    table: Callable[[Simulated], pd.DataFrame]
    applies: Callable[[Simulated], bool] = _always
