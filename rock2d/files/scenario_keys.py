"""The keys of a scenario's `model`, `incident`, `outputs` and `project`, with their units and bounds."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import date
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import BeforeValidator, Discriminator, Field, Tag, field_validator, model_validator

from rock2d.files.checked_yaml import Checked, Table, mistake, shown
from rock2d.files.distributions import Draw, Lognormal, Normal, Uniform, largest_magnitude
from rock2d.files.setup_keys import FARTHEST_M, Coordinate, Name, Point
from rock2d.records.columns import STATE_NAMES
from rock2d.scene.soils import SOIL_CLASSES

LONGEST_VIDEO_S = 20.0  # longest video of a release, unless the file gives slow_motion
LONGEST_TEXT = 200  # characters of a line in the head of a report
SLOW_MOTION_FACTORS = (10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1)
Stiffness = Annotated[float, Field(gt=0, le=1.0e15)]
SpringStiffness = Annotated[float, Field(ge=0, le=1.0e15)]
FrictionAngle = Annotated[float, Field(ge=0, le=90)]
SoilName = Annotated[str, Field(json_schema_extra={"enum": list(SOIL_CLASSES)})]  # `scenario_checks` refuses others


class ContactKeys(Checked):
    """Parameters of the deterministic contact law in one zone."""

    old_keys: ClassVar[Mapping[str, str]] = {"rolling_in_crater": "rolling_in_indentation"}
    k_l_N_m: Stiffness | None = Field(default=None, description="Loading stiffness in N/m")
    k_ul_N_m: Stiffness | None = Field(default=None, description="Unloading stiffness in N/m, at least k_l_N_m")
    k_t_N_m: SpringStiffness | None = Field(default=None, description="Tangential stiffness in N/m")
    friction_angle_deg: FrictionAngle | None = Field(
        default=None, description="Friction angle in degrees; 90 never slips"
    )
    k_r_Nm_rad: SpringStiffness | None = Field(default=None, description="Rolling stiffness in N m/rad")
    rolling_cap: bool | None = Field(
        default=None, description="Limit the rolling moment to arm x normal force (the paper does not); false"
    )
    rolling_in_indentation: bool | None = Field(
        default=None, description="The rolling spring acts until the block is clear of the ground; false: while pressed"
    )


class ReboundKeys(Checked):
    """Parameters of the probabilistic rebound law in one zone."""

    friction_angle_deg: float | None = Field(default=None, ge=0, lt=90, description="Friction angle in degrees")
    momentum_half_kg_m_s: float | None = Field(
        default=None, gt=0, le=1.0e12, description="Normal momentum at which restitution is one half, in kg m/s"
    )
    tangential_restitution: float | None = Field(default=None, ge=0, le=1, description="r_t, without unit")
    slope_reduction_deg: float | None = Field(
        default=None, ge=0, lt=90, description="Local reduction of the slope angle in degrees"
    )
    slope_reduction: Literal["constant", "uniform"] | None = Field(
        default=None, description="Reduce by slope_reduction_deg always, or by U(0, slope_reduction_deg); constant"
    )


class ContactTable(Table):
    """Zone name, or default, -> parameters; a zone may give some of them, the rest come from its soil class, then from
    default, then from the soil class of default."""

    default: ContactKeys = Field(
        default_factory=ContactKeys,
        description="Parameters of every zone that does not give its own; required without soils",
    )
    __pydantic_extra__: dict[str, ContactKeys] = Field(init=False)


class ReboundTable(Table):
    """Zone name, or default, -> parameters."""

    default: ReboundKeys = Field(default_factory=ReboundKeys, description="Parameters of every other zone")
    __pydantic_extra__: dict[str, ReboundKeys] = Field(init=False)


class BlockReboundTable(Table):
    """Block name, or default, -> zone -> parameters. A block and zone may give some; the rest come from the
    block's default, then default's zone, then the zone's soil class, then default's default, then the soil class of
    default."""

    default: ReboundTable = Field(
        default_factory=ReboundTable,
        description="Zones of every block that does not give its own; required without soils",
    )
    __pydantic_extra__: dict[str, ReboundTable] = Field(init=False)


class SoilKeys(Checked):
    """A soil class with numbers of your own, which hold for blocks of all sizes."""

    like: SoilName = Field(description="The soil class that gives what is not given here")
    restitution: float | None = Field(
        default=None, ge=0.01, lt=1, description="Normal restitution at the reference impact, without unit"
    )
    friction_angle_deg: float | None = Field(
        default=None, ge=0, lt=90, description="Friction angle of both laws in degrees"
    )
    stiffness: float | None = Field(
        default=None, gt=0, le=1.0e6, description="k_l x size / (mass x gravity), without unit"
    )
    tangential_restitution: float | None = Field(
        default=None, ge=0, le=1, description="r_t of the rebound law, without unit"
    )
    slope_reduction_deg: float | None = Field(
        default=None, ge=0, lt=90, description="Roughness of the ground: the rebound law draws from U(0, this)"
    )


def _known_soil(value: Any) -> Any:
    if isinstance(value, (str, dict, SoilKeys)):
        return value
    raise mistake(f"expected the name of a soil class or a mapping with the key like, found {shown(value)}")


Soil = Annotated[
    Annotated[SoilName, Tag("<name>")] | Annotated[SoilKeys, Tag("<keys>")],
    Discriminator(lambda value: "<name>" if isinstance(value, str) else "<keys>"),
    BeforeValidator(_known_soil),
]


class Laws(Checked):
    """Soil classes, a diagnosis, or parameters of one or both impact laws. Numbers take precedence over classes and
    over the diagnosis."""

    soils: dict[Name, Soil] | None = Field(
        default=None,
        min_length=1,
        description="Zone name, or default, -> soil class, or {like: soil class, and numbers of your own}; gives the "
        "parameters of both laws for each block. `rock2d soils` lists the classes",
    )
    diagnosis: str | None = Field(
        default=None,
        description="Path of a diagnosis.json or its folder, relative to this file or to the data root (--data or "
        "ROCK2D_DATA): the fitted soil for every zone that does not give its own, and the effects that were found",
    )
    deterministic: ContactTable | None = Field(default=None, description="Elasto-plastic contact (engine pymunk)")
    probabilistic: BlockReboundTable | None = Field(
        default=None, description="Bourrier-Hungr rebound (engine point_mass)"
    )

    @model_validator(mode="after")
    def _default_without_soils(self) -> Laws:
        for law in ("deterministic", "probabilistic"):
            table = getattr(self, law)
            fitted = law == "deterministic" and self.diagnosis is not None
            if self.soils is None and not fitted and table is not None and "default" not in table.model_fields_set:
                raise mistake("missing key 'default'", law, at="key", code="missing_key", key="default")
        return self


class Fixed(Checked):
    """One state for every release."""

    x_m: Coordinate = Field(description="Centroid, to the right, in m")
    y_m: Coordinate = Field(description="Centroid, up, in m")
    theta_rad: float = Field(default=0.0, ge=-1e3, le=1e3, description="Orientation, counter-clockwise, in rad")
    vx_m_s: float = Field(ge=-1e3, le=1e3, description="Velocity to the right in m/s")
    vy_m_s: float = Field(ge=-1e3, le=1e3, description="Velocity up in m/s")
    omega_rad_s: float = Field(default=0.0, ge=-1e5, le=1e5, description="Spin, counter-clockwise, in rad/s")


class _Motion(Checked):
    """Draws for each release: a number, {normal: {mean, sd}}, {uniform: {low, high}} or {lognormal: {median, cv}}."""

    theta_rad: Draw = Field(default=0.0, description="Orientation, counter-clockwise, in rad")
    vx_m_s: Draw = Field(description="Velocity to the right in m/s")
    vy_m_s: Draw = Field(description="Velocity up in m/s")
    omega_rad_s: Draw = Field(default=0.0, description="Spin, counter-clockwise, in rad/s")

    @model_validator(mode="after")
    def _within_reach(self) -> _Motion:
        for key, value in self:
            if key != "points_m" and (found := largest_magnitude(value)) > FARTHEST_M:
                raise mistake(f"expected numbers up to {FARTHEST_M:g}, found {found:g}", key)
        return self


class Distribution(_Motion):
    """Six draws for each release: a number, a normal, a uniform or a lognormal distribution each."""

    x_m: Draw = Field(description="Centroid, to the right, in m")
    y_m: Draw = Field(description="Centroid, up, in m")


class AboveGround(_Motion):
    """A start above the ground, wherever the ground is."""

    x_m: Draw = Field(description="Centroid, to the right, in m")
    clearance_m: Draw = Field(
        description="Free height between the block and the ground under it, in m; 0: the block touches the ground"
    )


class Along(_Motion):
    """A start on a line, for example the edge of a cliff; every part of its length is as likely."""

    points_m: list[Point] = Field(min_length=2, description="Polyline on which the centroid starts: [[x, y], ...] in m")

    @model_validator(mode="after")
    def _has_length(self) -> Along:
        if all(point == self.points_m[0] for point in self.points_m):
            raise mistake("expected at least two different points", "points_m")
        return self


class FromExperiment(Checked):
    """Each filmed release restarts from its own first frames."""

    folder: str = Field(description="Experiment folder, relative to the data root (--data or ROCK2D_DATA)")
    frames: int = Field(default=10, ge=3, le=10_000, description="Largest number of first frames that are fitted")


class Incident(Checked):
    """The state at the start of a release: exactly one of these."""

    fixed: Fixed | None = Field(default=None, description="The same state for every release")
    distribution: Distribution | None = Field(default=None, description="A state drawn for each release")
    above_ground: AboveGround | None = Field(
        default=None, description="A state drawn for each release, at a height above the ground"
    )
    along: Along | None = Field(default=None, description="A state drawn for each release, on a line of release points")
    from_experiment: FromExperiment | None = Field(default=None, description="The measured states of filmed releases")

    @model_validator(mode="after")
    def _exactly_one(self) -> Incident:
        kinds = list(type(self).model_fields)
        given = [name for name in kinds if getattr(self, name) is not None]
        if len(given) != 1:
            raise mistake(
                f"expected exactly one of {', '.join(kinds)}, found " + (" and ".join(given) or "none"), at="key"
            )
        return self

    def draw(self, generator: Any, count: int) -> Any:
        """(count, 6) states in the order of `STATE_NAMES`, drawn with a numpy Generator.

        With `above_ground`, y_m is the clearance. Raises ValueError for from_experiment."""
        source = self.fixed or self.distribution or self.above_ground or self.along
        if source is None:
            raise ValueError("measured incident states are fitted, not drawn")
        states = np.empty((len(STATE_NAMES), count)).T  # so that each draw fills contiguous memory
        if self.along is not None:
            states[:, :2] = _points_along(np.array(self.along.points_m), generator.uniform(size=count))
        for i, key in enumerate(STATE_NAMES):
            key = "clearance_m" if self.above_ground is not None and key == "y_m" else key
            if self.along is None or key not in ("x_m", "y_m"):
                states[:, i] = _drawn(getattr(source, key), generator, count)
        return states


def _drawn(value: Any, generator: Any, count: int) -> Any:
    if isinstance(value, Normal):
        return generator.normal(value.normal.mean, value.normal.sd, count)
    if isinstance(value, Uniform):
        return generator.uniform(value.uniform.low, value.uniform.high, count)
    if isinstance(value, Lognormal):
        return generator.lognormal(*value.lognormal.log_mean_sd, count)
    return value


def _points_along(points_m: Any, share: Any) -> Any:
    """(n, 2) points at fractions (n,) of the length of a polyline."""
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points_m, axis=0).T))])
    return np.column_stack([np.interp(share * length[-1], length, side) for side in points_m.T])


Factor = Annotated[float, Field(ge=1, le=10)]


class UniKeys(Checked):
    """Partial factors of UNI 11211-4."""

    gamma_tr: Factor = Field(
        default=1.10,
        description="Reliability of the simulation: 1.02 calibrated on site, 1.10 parameters from literature",
    )
    gamma_dp: Factor = Field(default=1.10, description="Quality of the topographic survey: 1.02 good, 1.10 poor")
    gamma_vol: Factor = Field(
        default=1.10, description="Precision of the survey of block volumes: 1.02 good, 1.10 poor"
    )
    gamma_gamma: Factor = Field(default=1.00, description="Unit weight of the rock: 1.00")
    gamma_r: Factor = Field(
        default=1.00,
        description="Risk: 1.00 for small consequences that can be repaired, up to 1.20 for great danger to people",
    )


class OnrKeys(Checked):
    """Partial factors of ONR 24810; the defaults are those of consequence class CC2."""

    gamma_e: Factor = Field(default=1.05, description="Energy: CC1 1.00, CC2 1.05, CC3 1.15")
    gamma_h: Factor = Field(default=1.10, description="Passing height: CC1 1.05, CC2 1.10, CC3 1.30")


class DesignValueKeys(Checked):
    """Partial factors of the norms by which design values are given."""

    uni_11211_4: UniKeys = Field(default_factory=UniKeys, description="Factors of UNI 11211-4")
    onr_24810: OnrKeys = Field(default_factory=OnrKeys, description="Factors of ONR 24810")


class Outputs(Checked):
    """How the simulated releases are recorded."""

    fps: float = Field(default=250.0, gt=0, le=1.0e5, description="Frames per second of the written trajectories")
    position_noise_m: float = Field(default=0.0, ge=0, le=1e3, description="Noise added to positions, 1 sigma, in m")
    angle_noise_rad: float = Field(default=0.0, ge=0, le=1e3, description="Noise added to angles, 1 sigma, in rad")
    slow_motion: float | None = Field(
        default=None,
        gt=0,
        le=1e4,
        description="Factor by which the video is slowed down; default: 10, or as much less as makes a release last "
        "at most 20 s",
    )
    video_releases: int = Field(default=3, ge=1, le=1000, description="Releases of each block in the video")

    def slowed(self, longest_s: float) -> float:
        """Slow-motion factor of a video whose longest release lasts `longest_s`."""
        if self.slow_motion is not None:
            return self.slow_motion
        return next(
            (factor for factor in SLOW_MOTION_FACTORS if factor * longest_s <= LONGEST_VIDEO_S), SLOW_MOTION_FACTORS[-1]
        )


def _text(description: str) -> str:
    return Field(default="", max_length=LONGEST_TEXT, description=description)


class Project(Checked):
    """Head of the report. What is not given is left out."""

    title: str = _text("Title of the project")
    number: str = _text("Number of the project or the document, in quotes if it has digits alone")
    client: str = _text("Who asked for the report")
    author: str = _text("Who made it, and signs")
    checked_by: str = _text("Who checked it, and signs")
    date: str = _text("Date of the report, year-month-day")

    @field_validator("date")
    @classmethod
    def _iso(cls, text: str) -> str:
        try:
            day = date.fromisoformat(text).isoformat()
        except ValueError:
            day = ""
        if day != text:  # other forms of ISO 8601, such as 20250331
            raise mistake(f"expected a date as 2025-03-31, found {shown(text)}")
        return text
