"""Changes of the model of a field test, and their gains on held-out releases."""

import copy
from collections.abc import Callable
from dataclasses import astuple, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from rock2d.field_tests.study import Calibration, Effort, OnProgress, calibrate, study_forecasts
from rock2d.files.scenario import Scenario
from rock2d.files.scenario_reading import checked_scenario
from rock2d.scene.blocks import make_block

EFFORT_DIVISOR = 4  # factor by which less is simulated for a change than for the calibration
Data = dict[str, Any]


def _smooth(data: Data) -> bool:
    """Without roughness smaller than the cells of the terrain."""
    _drop_unknowns(data, "roughness.")
    return bool(data.pop("roughness", None))


def _one_soil(data: Data) -> bool:
    """The soil of the steepest zone everywhere."""
    zones = data["field_test"]["zones"]
    steepest = max(zones, key=zones.get)
    others = [zone for zone in zones if zone != steepest]
    data["field_test"]["zones"] = {steepest: -90.0}
    for zone in others:
        for holder, key in ((data["model"], "soils"), (data, "roughness"), (data["model"], "deterministic")):
            holder.get(key, {}).pop(zone, None)
        for parts in (f"model.soils.{zone}.", f"roughness.{zone}.", f"model.deterministic.{zone}."):
            _drop_unknowns(data, parts)
    data["model"].pop("probabilistic", None)
    _drop_unknowns(data, "model.probabilistic.")
    return bool(others)


def _level_beyond(data: Data) -> bool:
    """Level ground beyond the known stops."""
    _drop_unknowns(data, "field_test.beyond_deg")
    data["field_test"]["beyond_deg"] = 0.0
    return True


def _circles(data: Data) -> bool:
    """Discs of the same area instead of polygons."""
    for name, keys in data["blocks"].items():
        if keys["shape"] != "polygon":
            return False
        mass = keys["mass_kg"]
        size = make_block(name, "polygon", mass, vertices_m=keys["vertices_m"]).size_m
        data["blocks"][name] = {"shape": "circle", "diameter_m": size, "mass_kg": mass, "inertia": "uniform"}
    return True


def _lower_sections(data: Data) -> bool:
    """Sections of blocks a third less high."""
    for keys in data["blocks"].values():
        if keys["shape"] != "polygon":
            return False
        keys["vertices_m"] = [[x, y * 2.0 / 3.0] for x, y in keys["vertices_m"]]
    return True


# name of a change -> function that changes the data of a scenario file in place; it returns False if there is nothing
# to change
CHANGES = {
    "smooth ground": _smooth,
    "one soil": _one_soil,
    "level ground beyond the stops": _level_beyond,
    "discs instead of boulders": _circles,
    "sections a third less high": _lower_sections,
}


def candidate_table(
    scenario: Scenario, base: Calibration, stages: Path | None, on_progress: OnProgress
) -> pd.DataFrame:
    """Gain of each change in log score per held-out release over the unchanged model; columns change, gain, gain_se
    (standard error). All are calibrated with the same reduced effort."""
    prior, refined, copies, draws = astuple(base.effort)
    effort = Effort(prior // EFFORT_DIVISOR, refined // EFFORT_DIVISOR, copies, draws // EFFORT_DIVISOR)

    def scores(own: Scenario, name: str) -> np.ndarray:
        def show(what: str, done: int, of: int) -> None:
            on_progress(f"{name}, {what}", done, of)

        found = calibrate(own, "batch", base.seed, stages, effort, show)
        held_out = study_forecasts(own, found)["blocks, held out"]
        assert own.terrain is not None
        return held_out.forecast.log_scores(own.terrain.known.distances_m[held_out.indices])

    as_it_is = scores(scenario, "as it is")
    rows = []
    for name, change in CHANGES.items():
        changed = _changed(scenario, change)
        if changed is not None:
            gain = scores(changed, name) - as_it_is
            rows.append((name, gain.mean(), gain.std(ddof=1) / np.sqrt(len(gain))))
    return pd.DataFrame(rows, columns=["change", "gain", "gain_se"])


def _changed(scenario: Scenario, change: Callable[[Data], bool]) -> Scenario | None:
    document, terrain = scenario.document, scenario.terrain
    assert terrain is not None
    data = copy.deepcopy(document.data)
    if not change(data):
        return None
    zones = {name: float(least) for name, least in data["field_test"]["zones"].items()}
    return checked_scenario(document.with_data(data), None, terrain=replace(terrain, zones=zones))


def _drop_unknowns(data: Data, start: str) -> None:
    """Remove places with this beginning from the key `uncertainty`, because the change fixes them."""
    site = data.get("uncertainty", {}).get("site", {})
    for place in [place for place in site if place.startswith(start)]:
        del site[place]
