"""Small diagnoses, written by hand, and a scenario that runs with one."""

import json
from pathlib import Path
from typing import Any

from rock2d.files.scenario import Scenario
from rock2d.files.scenario_reading import load_scenario
from tests.scenarios_of_tests import BALL, THROWN, scenario_file

SOIL = {"k_l_N_m": 4e6, "k_ul_N_m": 2.4e7, "k_t_N_m": 1e6, "friction_angle_deg": 30.0, "k_r_Nm_rad": 4e3}
GAIN = {"heldout_score_gain": 9.0, "heldout_score_gain_se": 1.0}
CLOSED = {"closure": 0.9, "closure_ci95": [0.8, 1.0]}
GAP = {"unit": "noise", "base": 4.0, "augmented": 1.2, "noise_floor": 1.0, **CLOSED}
JOINT = {**SOIL, "k_ul_N_m": 3.0e7}  # fitted together with an effect
BLOCKS = f"blocks:\n  ball: {BALL}\n  box: {{shape: square, side_m: 0.6, mass_kg: 580, inertia: uniform}}"
INCIDENT = f"distribution: {{{THROWN}, theta_rad: {{uniform: {{low: 0.0, high: 1.0}}}}}}"


def effect(base: dict[str, float] = JOINT, **parameters: tuple[float, float, float]) -> dict[str, Any]:
    """An entry of `effects`; parameters are value and ends of the 95 % interval."""
    own = {name: {"value": v, "ci95": [low, high], "unit": "1"} for name, (v, low, high) in parameters.items()}
    return {"parameters": own, "base": base, **GAIN, **CLOSED}


def content(verdict: str = "none", effects: dict[str, Any] | None = None, **more: Any) -> dict[str, Any]:
    """A diagnosis of schema 1."""
    found = verdict not in ("none", "unknown")
    return {
        "schema": 1, "experiment": "bench", "base": SOIL, "law": {"rolling_in_indentation": False},
        "verdict": verdict, "group": [verdict] if found else [], "probabilities": {verdict: 1.0},
        "effects": effects or {}, "where": [], "gap": GAP, **more,
    }  # fmt: skip


def with_learnt(base: dict[str, float], *changes: dict[str, Any]) -> dict[str, Any]:
    """A `model` of a law, no effect, and learnt changes."""
    fit = {"base": base, "parameters": {}}
    return {**fit, "learnt": {**fit, "changes": list(changes)}}


def diagnosed(
    folder: Path, given: dict[str, Any], *, model: str = "{diagnosis: d.json}", engine: str = "batch", more: str = ""
) -> Scenario:  # fmt: skip
    """The scenario with this diagnosis beside it."""
    (folder / "d.json").write_text(json.dumps(given, indent=1))
    return undiagnosed(folder, model, engine, more)


def undiagnosed(folder: Path, model: str, engine: str = "batch", more: str = "") -> Scenario:
    """The scenario with this model."""
    options = {"engine": engine, "releases": 5, "blocks": BLOCKS, "incident": INCIDENT, "more": more}
    return load_scenario(scenario_file(folder, "diagnosed", model=model, **options))


def numbers(soil: dict[str, float]) -> str:
    """A `model` with this soil by hand."""
    return json.dumps({"deterministic": {"default": soil}})
