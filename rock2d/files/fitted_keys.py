"""What a diagnosis fitted, as keys of diagnosis.json: the law, effects with their parameters, learnt changes."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import ConfigDict, Field, model_validator

from rock2d.errors import ParameterError
from rock2d.files.checked_yaml import Checked, mistake
from rock2d.files.scenario_keys import FrictionAngle, SpringStiffness, Stiffness
from rock2d.laws.contact import ContactParameters

Number = Annotated[float, Field(ge=-1.0e300, le=1.0e300)]
NotNegative = Annotated[float, Field(ge=0, le=1.0e300)]
FittedFloat = Annotated[float, Field(ge=-1.0e15, le=1.0e15)]
Interval = Annotated[
    list[Number], Field(min_length=2, max_length=2, description="Lower and upper end of the 95 % interval")
]
Gain = Annotated[Number, Field(description="Gain in log likelihood on releases that no fit saw")]
GainError = Annotated[NotNegative, Field(description="Its standard error")]


class Part(Checked):
    """Known keys; a reader ignores those that it does not know."""

    model_config = ConfigDict(extra="ignore", strict=True, allow_inf_nan=False)


class FittedLaw(Part):
    """Parameters of the contact law."""

    k_l_N_m: Stiffness = Field(description="Loading stiffness in N/m")
    k_ul_N_m: Stiffness = Field(description="Unloading stiffness in N/m, at least k_l_N_m")
    k_t_N_m: SpringStiffness = Field(description="Tangential stiffness in N/m")
    friction_angle_deg: FrictionAngle = Field(description="Friction angle in degrees; 90 never slips")
    k_r_Nm_rad: SpringStiffness = Field(description="Rolling stiffness in N m/rad")

    @model_validator(mode="after")
    def _makes_sense(self) -> FittedLaw:
        try:
            ContactParameters(**self.model_dump())
        except ParameterError as error:
            raise mistake(error.message, error.key, code="bad_parameter", key=error.key) from None
        return self


class FittedNumber(Part):
    """A fitted number."""

    value: FittedFloat = Field(description="Fitted value")
    ci95: Interval

    @model_validator(mode="after")
    def _in_order(self) -> FittedNumber:
        low, high = self.ci95
        if not low <= self.value <= high:
            raise mistake(f"expected an interval that holds the value {self.value:g}", "ci95")
        return self


class OfBlock(FittedNumber):
    """A parameter of one block."""

    drag_coefficient: FittedNumber | None = Field(
        default=None,
        description="Of drag with the square of the velocity: C_d in air of 1.2 kg/m³, for a body as deep as its "
        "profile is high",
    )


class FittedParameter(FittedNumber):
    """A fitted parameter."""

    unit: str = Field(description="Unit; 1 for a number without unit")
    choice: str | None = Field(default=None, description="Name of the value, where it is one of a few choices")
    by_block: dict[str, OfBlock] | None = Field(
        default=None, description="Block to its own value, where each has one; the value is then their mean"
    )


Parameters = Annotated[dict[str, FittedParameter], Field(description="Parameter name to value, 95 % interval and unit")]


class JointFit(Part):
    """Effects that were fitted together."""

    base: FittedLaw
    parameters: dict[str, Parameters] = Field(description="Effect to its parameters in the joint fit")


class CurveKeys(Part):
    """Functions of one quantity."""

    quantity: str = Field(description="What the functions depend on, with its unit")
    kind: Literal["spline", "harmonics", "kinds", "line", "waves"] = Field(description="Kind of functions")
    numbers: list[Number] = Field(
        min_length=1,
        description="Breakpoints of a spline, numbers of harmonics, members of kinds, unit of a line, angular "
        "frequencies of waves",
    )
    names: list[str] | None = Field(default=None, description="Names of the members of kinds: blocks or zones")
    measured: list[Number] | None = Field(
        default=None, min_length=2, max_length=2, description="Lowest and highest measured value of a line or waves"
    )


class ChangeKeys(Part):
    """A learnt change."""

    lever: Literal["law", "slope", "profile", "incident state", "outcome", "frame", "flight"] = Field(
        description="What changes"
    )
    depends_on: str = Field(description="What it depends on")
    curves: list[CurveKeys] = Field(description="Functions of each quantity, side by side; none is a constant")
    coefficients: list[list[Number]] = Field(
        min_length=1,
        description="A row for each number of the lever, in SI; of the law, logarithms of k_l, k_ul / k_l, k_t, "
        "tan phi, k_r",
    )
    heldout_score_gain: Number | None = Field(
        default=None, description="Gain in log likelihood on releases that no fit saw"
    )
    heldout_score_gain_se: NotNegative | None = Field(default=None, description="Its standard error")


class LearntFit(JointFit):
    """The law and the effects as fitted together with the learnt changes."""

    changes: list[ChangeKeys] = Field(description="The learnt changes, in the order in which they were found")


class JointModel(JointFit):
    """The joint fit of all causes."""

    learnt: LearntFit | None = Field(
        default=None, description="The same fitted together with the learnt changes, for predictions of this set-up"
    )
