"""The key `field_test` of a scenario: measured releases of real blocks on a slope, and the terrain."""

from __future__ import annotations

from pydantic import Field, model_validator

from rock2d.files.checked_yaml import Checked, mistake
from rock2d.files.setup_keys import Name


class FieldTestKeys(Checked):
    """Releases of which starts and stops were measured. The ground is the terrain along their ways."""

    folder: str = Field(
        description="Folder of the data, relative to the data root (--data or ROCK2D_DATA); the root may also be that "
        "folder, or one between"
    )
    releases: str = Field(default="releases.csv", description="Table of starts and stops in that folder")
    terrain: str = Field(
        default="terrain.asc", description="Terrain model (GeoTIFF, ESRI ASCII grid) in that folder"
    )
    block_ids: dict[Name, int] = Field(
        min_length=1, description="Name of a block under blocks -> its block_id in the table"
    )
    zones: dict[Name, float] = Field(
        min_length=1,
        description="Zone name -> inclination in degrees from which the ground belongs to it; the steepest that holds "
        "counts, one must be 0 or less",
    )
    edge_m: float = Field(
        default=0.0, ge=0, le=100, description="Length of the ground at the start that is zone edge, in m"
    )
    beyond_deg: float = Field(
        default=0.0,
        ge=-30,
        le=80,
        description="Inclination of the ground beyond the known starts and stops, where the terrain is a guess; "
        "positive: it rises",
    )
    calibrate_on: list[Name] = Field(
        min_length=1, description="Blocks on which the soil is calibrated to predict the others"
    )

    @model_validator(mode="after")
    def _all_ground_has_a_zone(self) -> FieldTestKeys:
        if min(self.zones.values()) > 0.0:
            raise mistake("one zone must begin at 0 degrees or less", "zones")
        return self
