"""A hypothesis as a scenario file, which `rock2d run` accepts."""

from __future__ import annotations

from collections.abc import Mapping
from io import StringIO
from typing import Any

import numpy as np

from rock2d.files.setup_keys import block_keys
from rock2d.records.columns import STATE_NAMES
from rock2d.reproduction import published
from rock2d.reproduction.hypotheses import (
    KnownSetup,
    Values,
    hypothesis_cross_section,
    incident_distributions,
)
from rock2d.reproduction.outcomes import TIME_LIMIT_S


def scenario_text(
    known: KnownSetup, values: Values, i: int, slope_reduction_deg: Mapping[str, float], seed: int, model: str
) -> str:
    """YAML of hypothesis `i` of a model, "deterministic" or "probabilistic"."""
    from ruamel.yaml import YAML

    ground = hypothesis_cross_section(values, i, known)
    law = (
        {"default": _contact(values, i)}
        if model == "deterministic"
        else _rebound(values, i, slope_reduction_deg)
    )
    incident = {}
    for block in published.BLOCKS:
        begin = incident_distributions(values, known.blocks[block], known.gravity_m_s2)
        incident[block] = {
            "distribution": {
                key: {"normal": {"mean": float(m), "sd": float(s)}} if s > 0 else float(m)
                for key, m, s in zip(STATE_NAMES, begin.mean[i], begin.sd[i], strict=True)
            }
        }
    keys_of_scenario = {
        "name": f"paper_{model}",
        "about": f"The paper's set-up according to the likeliest hypothesis of the {model} model.",
        "assumed": [
            "One of many hypotheses that explain the sphere and the statements on first impacts; see assumptions.csv.",
            "Releases start when they leave the slope for the last time.",
            *published.MEANINGS,
        ],
        "gravity_m_s2": float(known.gravity_m_s2),
        "engine": "batch" if model == "deterministic" else "point_mass",
        "releases": published.RELEASES,
        "seed": int(seed),
        "time_limit_s": TIME_LIMIT_S,
        "cross_section": {
            "points_m": np.asarray(ground.points_m, float).tolist(),
            "zones": list(ground.zones),
            "measure_lines": {
                line: np.asarray(ends, float).tolist() for line, ends in ground.measure_lines.items()
            },
        },
        "blocks": {block: block_keys(known.blocks[block]) for block in published.BLOCKS},
        "model": {model: law},
        "incident": incident,
        "outputs": {"fps": 1000.0},
    }
    yaml, text = YAML(typ="safe", pure=True), StringIO()
    yaml.default_flow_style = None
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    yaml.dump(keys_of_scenario, text)
    return text.getvalue()


def _contact(values: Values, i: int) -> dict[str, float]:
    keys = ("k_l_N_m", "k_t_N_m", "friction_angle_deg", "k_r_Nm_rad")
    contact = {key: float(values[key][i]) for key in keys}
    return contact | {"k_ul_N_m": contact["k_l_N_m"] / float(values["restitution"][i]) ** 2}


def _rebound(values: Values, i: int, slope_reduction_deg: Mapping[str, float]) -> dict[str, Any]:
    keys = ("friction_angle_deg", "momentum_half_kg_m_s", "tangential_restitution")
    zones = {
        zone: {key: float(values[f"{there}.{key}"][i]) for key in keys}
        for zone, there in (("default", "ditch"), ("uphill_face", "facing"))
    }
    return {"default": zones} | {
        block: {"default": {"slope_reduction_deg": alpha}} for block, alpha in slope_reduction_deg.items()
    }
