"""The command `rock2d soils`: the soil classes, and their parameters for a block."""

import itertools
from collections.abc import Callable
from typing import Any

from rock2d.errors import InputError
from rock2d.scene.soils import SOIL_CLASSES, Range
from rock2d.wording import aligned

CLASS_HEADER = ("class", "restitution", "friction in °", "stiffness κ", "r_t", "α in °")
CONTACT_HEADER = ("deterministic", "k_l_N_m", "k_ul_N_m", "k_t_N_m", "friction_angle_deg", "k_r_Nm_rad",
                  "contact in s", "penetration in m")  # fmt: skip
REBOUND_HEADER = ("probabilistic", "friction_angle_deg", "momentum_half_kg_m_s", "tangential_restitution",
                  "slope_reduction_deg")  # fmt: skip


def list_soils(mass_kg: float | None = None, size_m: float | None = None, report: Callable[[str], Any] = print) -> None:
    """Report the table of classes or, if mass and size of a block are given, their parameters for it.

    Raises InputError if only one of the two is given, or if one is not positive."""
    if (mass_kg is None) != (size_m is None):
        raise InputError("the parameters of a block need its --mass-kg and its --size-m", code="wrong_kind")
    if mass_kg is None or size_m is None:
        lines = _classes()
    else:
        for option, value in (("--mass-kg", mass_kg), ("--size-m", size_m)):
            if not 0 < value < float("inf"):
                raise InputError(f"{option}: expected a positive number, found {value:g}")
        lines = _for_block(mass_kg, size_m)
    for line in lines:
        report(line)


def _classes() -> list[str]:
    soils = SOIL_CLASSES.values()
    rows = [
        (
            soil.name,
            _with_range(soil.restitution, soil.restitution_range, ".2f"),
            _with_range(soil.friction_angle_deg, soil.friction_range_deg, "g"),
            _with_range(soil.stiffness, soil.stiffness_range, "g"),
            f"{soil.tangential_restitution:.2f}",
            f"{soil.slope_reduction_deg:g}",
        )
        for soil in soils
    ]
    words = [
        ("", f"{soil.name}: {soil.description}", f"  source: {soil.source}", f"  assumed: {soil.assumed}")
        for soil in soils
    ]
    return [*aligned([CLASS_HEADER, *rows]), *itertools.chain(*words)]


def _for_block(mass_kg: float, size_m: float) -> list[str]:
    from rock2d.laws.contact import contact_time_s, penetration_m
    from rock2d.laws.soil_scaling import reference_speed_m_s, soil_contact, soil_rebound

    speed = reference_speed_m_s(size_m)
    contacts, rebounds = [], []
    for soil in SOIL_CLASSES.values():
        law, point = soil_contact(soil, mass_kg, size_m), soil_rebound(soil, mass_kg, size_m)
        numbers = (law.k_l_N_m, law.k_ul_N_m, law.k_t_N_m, law.friction_angle_deg, law.k_r_Nm_rad,
                   contact_time_s(law, mass_kg), penetration_m(law, mass_kg, speed))  # fmt: skip
        contacts.append((soil.name, *(f"{value:.3g}" for value in numbers)))
        short = (point.friction_angle_deg, point.momentum_half_kg_m_s, point.tangential_restitution,
                 point.slope_reduction_deg)  # fmt: skip
        rebounds.append((soil.name, *(f"{value:.3g}" for value in short)))
    return [
        f"block of {mass_kg:g} kg, {size_m:g} m; reference impact: {speed:.3g} m/s into the ground",
        "",
        *aligned([CONTACT_HEADER, *contacts]),
        "",
        *aligned([REBOUND_HEADER, *rebounds]),
    ]


def _with_range(value: float, bounds: Range, form: str) -> str:
    low, high = (format(bound, form) for bound in bounds)
    return f"{value:{form}} ({low} to {high})"
