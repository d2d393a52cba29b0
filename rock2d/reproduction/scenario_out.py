"""A hypothesis as a scenario file, so that `rock2d run` and its figures take it from there."""

from __future__ import annotations

from collections.abc import Mapping
from io import StringIO
from typing import Any

import numpy as np

from rock2d.bench import block_keys
from rock2d.reproduction import published
from rock2d.reproduction.hypotheses import Values, starts, terrain
from rock2d.reproduction.passing import TIME_LIMIT_S, Known
from rock2d.track import STATE_NAMES


def scenario_text(
    known: Known,
    values: Values,
    i: int,
    slope_reduction_deg: Mapping[str, float],
    seed: int,
    name: str,
    about: str,
) -> str:
    """YAML of hypothesis `i` of PROBABILISTIC_SPACE, with the parameters of both models."""
    from ruamel.yaml import YAML

    ground = terrain(values, i, known.height_m, known.crest_m)
    keys = ("k_l_N_m", "k_t_N_m", "friction_angle_deg", "k_r_Nm_rad")
    contact = {key: float(values[key][i]) for key in keys}
    contact["k_ul_N_m"] = contact["k_l_N_m"] / float(values["restitution"][i]) ** 2
    rebound: dict[str, Any] = {
        zone: {
            key: float(values[f"{there}.{key}"][i])
            for key in ("friction_angle_deg", "momentum_half_kg_m_s", "tangential_restitution")
        }
        for zone, there in (("default", "ditch"), ("uphill_face", "facing"))
    }
    of_block = {
        block: {"default": {"slope_reduction_deg": float(alpha)}}
        for block, alpha in slope_reduction_deg.items()
    }
    incident = {}
    for block in published.BLOCKS:
        begin = starts(values, known.blocks[block], known.gravity_m_s2)
        incident[block] = {
            "distribution": {
                key: {"normal": {"mean": float(m), "sd": float(s)}} if s > 0 else float(m)
                for key, m, s in zip(STATE_NAMES, begin.mean[i], begin.sd[i], strict=True)
            }
        }
    keys_of_scenario = {
        "name": name,
        "about": about,
        "assumed": [
            "One hypothesis of many that explain the sphere and the words on first impacts; see assumptions.csv.",
            "Releases start as they leave the slope after the drop.",
        ],
        "gravity_m_s2": float(known.gravity_m_s2),
        "engine": "batch",
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
        "model": {"deterministic": {"default": contact}, "probabilistic": {"default": rebound, **of_block}},
        "incident": incident,
        "outputs": {"fps": 1000.0},
    }
    yaml, text = YAML(typ="safe", pure=True), StringIO()
    yaml.default_flow_style = None
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    yaml.dump(keys_of_scenario, text)
    return text.getvalue()
