"""The keys of diagnosis.json that a scenario reads: fitted soil, verdict, effects with their intervals, scale."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, model_validator

from rock2d.files.checked_yaml import Checked, mistake

Probability = Annotated[float, Field(ge=0, le=1)]
Finite = Annotated[float, Field(ge=-1.0e15, le=1.0e15)]


class _Part(Checked):
    """Keys that a scenario needs; other keys are not its concern."""

    model_config = ConfigDict(extra="ignore", strict=True, allow_inf_nan=False)


class SoilPart(_Part):
    """Parameters of the contact law."""

    k_l_N_m: float = Field(gt=0, le=1.0e15)
    k_ul_N_m: float = Field(gt=0, le=1.0e15)
    k_t_N_m: float = Field(ge=0, le=1.0e15)
    friction_angle_deg: float = Field(ge=0, le=90)
    k_r_Nm_rad: float = Field(ge=0, le=1.0e15)

    @model_validator(mode="after")
    def _makes_no_energy(self) -> SoilPart:
        if self.k_ul_N_m < self.k_l_N_m:
            message = f"expected at least k_l_N_m = {self.k_l_N_m:g}, found {self.k_ul_N_m:g}"
            raise mistake(message, "k_ul_N_m", code="bad_parameter", key="k_ul_N_m")
        return self


class ValuePart(_Part):
    """A fitted value with its 95 % interval."""

    value: Finite
    ci95: list[Finite] | None = Field(default=None, min_length=2, max_length=2)

    @model_validator(mode="after")
    def _in_order(self) -> ValuePart:
        low, high = self.ci95 or (self.value, self.value)
        if not low <= self.value <= high:
            raise mistake(f"expected an interval that holds the value {self.value:g}", "ci95")
        return self


class EffectPart(_Part):
    """An effect as it was fitted, alone."""

    parameters: dict[str, ValuePart]
    base: SoilPart | None = None


class BesidePart(_Part):
    """All effects up to this one, fitted together."""

    effect: str
    parameters: dict[str, dict[str, ValuePart]]
    base: SoilPart


class CausePart(_Part):
    """One of several causes (schema 2)."""

    effect: str
    p: Probability
    parameters: dict[str, ValuePart]


class ModelPart(_Part):
    """The joint fit of all causes (schema 2)."""

    base: SoilPart
    parameters: dict[str, dict[str, ValuePart]]


class LawPart(_Part):
    """Which reading of the law the data chose."""

    rolling_in_indentation: bool = False
    rolling_in_crater: bool | None = None  # the old name


class ScalePart(_Part):
    """A block of the experiment."""

    mass_kg: float = Field(gt=0, le=1.0e12)
    size_m: float = Field(gt=0, le=1.0e6)


class DiagnosisKeys(_Part):
    """A diagnosis, as far as a scenario reads it."""

    schema_: Literal[1, 2] = Field(alias="schema")
    experiment: str
    base: SoilPart
    law: LawPart = LawPart()
    verdict: str
    group: list[str] = Field(default=[])
    probabilities: dict[str, Probability] = Field(default={})
    effects: dict[str, EffectPart] = Field(default={})
    beside: list[BesidePart] = Field(default=[])
    causes: list[CausePart] = Field(default=[])
    model: ModelPart | None = None
    blocks: dict[str, ScalePart] = Field(default={})
    gravity_m_s2: float | None = Field(default=None, ge=0, le=1000)

    @model_validator(mode="before")
    @classmethod
    def _has_a_law(cls, data: Any) -> Any:
        if isinstance(data, dict) and data.get("base") == {}:
            message = "this diagnosis has no fitted law: its experiment failed the sanity checks"
            raise mistake(message, "base", code="missing_key", key="base")
        return data
