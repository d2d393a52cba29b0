"""Design values by two norms: characteristic percentiles at a measure line times the norm's partial factors.

Sources: UNI 11211-4:2012, Opere di difesa dalla caduta massi, part 4; its formulas as in D. Peila and C. Ronco, Nat.
Hazards Earth Syst. Sci. 9 (2009) 1291. ONR 24810:2017, Technischer Steinschlagschutz. The factors were not
compared with the text of the norms: compare them before use.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from rock2d.statistics import Estimate

CHARACTERISTIC_PERCENTILE = 95.0
LEAST_FREEBOARD_M = 0.5


class DesignValue(NamedTuple):
    """A design value.

    Attributes
    ----------
    quantity : with its unit at the end
    factors : how it follows from the characteristic value, in words and numbers
    """

    norm: str
    quantity: str
    characteristic: Estimate
    factors: str
    design: Estimate


@dataclass(frozen=True)
class UniFactors:
    """Partial factors of UNI 11211-4.

    Attributes
    ----------
    gamma_tr : reliability of the simulation: 1.02 calibrated on site, 1.10 parameters from literature
    gamma_dp : quality of the topographic survey: 1.02 good, 1.10 poor
    gamma_vol : precision of the survey of block volumes: 1.02 good, 1.10 poor
    gamma_gamma : unit weight of the rock, 1.00
    gamma_r : risk: 1.00 for small consequences that can be repaired, up to 1.20 for great danger to people
    """

    gamma_tr: float = 1.10
    gamma_dp: float = 1.10
    gamma_vol: float = 1.10
    gamma_gamma: float = 1.00
    gamma_r: float = 1.00


@dataclass(frozen=True)
class OnrFactors:
    """Partial factors of ONR 24810 for consequence class CC2 (CC1: 1.00 and 1.05, CC3: 1.15 and 1.30).

    Attributes
    ----------
    gamma_e : factor on the kinetic energy
    gamma_h : factor on the passing height
    """

    gamma_e: float = 1.05
    gamma_h: float = 1.10


def uni_11211_4(
    at_line: Mapping[str, Estimate], mass_kg: float, size_m: float, factors: UniFactors
) -> list[DesignValue]:
    """Design velocity, mass, energy and height at a line.

    Parameters
    ----------
    at_line : "speed_m_s" and "passing_height_m" -> 95th percentile of the blocks that pass
    mass_kg, size_m : of the design block

    v_d = v_95 γTr γDp; m_d = m γVol γγ; E_d = γR ½ m_d v_d²; H_d = H_95 γTr γDp + f, with the freeboard f the radius of
    the block and at least 0.5 m.
    """
    f, norm = factors, "UNI 11211-4"
    paths, masses = f.gamma_tr * f.gamma_dp, f.gamma_vol * f.gamma_gamma
    speed, height = at_line["speed_m_s"], at_line["passing_height_m"]
    fast = speed.times(paths)
    heavy = mass_kg * masses
    energy = Estimate(*(f.gamma_r * 0.5 * heavy * v**2 for v in fast))
    plain = Estimate(*(0.5 * mass_kg * v**2 for v in speed))
    freeboard = max(0.5 * size_m, LEAST_FREEBOARD_M)
    on_paths = f"gamma_Tr {f.gamma_tr:g} x gamma_Dp {f.gamma_dp:g}"
    on_mass = f"gamma_Vol {f.gamma_vol:g} x gamma_gamma {f.gamma_gamma:g}"
    return [
        DesignValue(norm, "speed_m_s", speed, on_paths, fast),
        DesignValue(
            norm, "mass_kg", Estimate(mass_kg, mass_kg, mass_kg), on_mass, Estimate(heavy, heavy, heavy)
        ),
        DesignValue(
            norm, "energy_J", plain, f"gamma_R {f.gamma_r:g} x {on_mass} x ({on_paths})^2", energy
        ),
        DesignValue(
            norm, "height_m", height, f"{on_paths}, + freeboard {freeboard:.3g} m",
            height.times(paths).plus(freeboard),
        ),
    ]  # fmt: skip


def onr_24810(at_line: Mapping[str, Estimate], factors: OnrFactors) -> list[DesignValue]:
    """Design energy and height at a line: E_d = E_95 γE, H_d = H_95 γH; `at_line` has "kinetic_J" and
    "passing_height_m"."""
    norm, energy, height = "ONR 24810", at_line["kinetic_J"], at_line["passing_height_m"]
    return [
        DesignValue(norm, "energy_J", energy, f"gamma_E {factors.gamma_e:g}", energy.times(factors.gamma_e)),
        DesignValue(norm, "height_m", height, f"gamma_H {factors.gamma_h:g}", height.times(factors.gamma_h)),
    ]
