"""Scenarios that differ from a given one in some numbers. Places such as `embankment.height_m` name the numbers."""

import copy
from collections.abc import Callable, Mapping
from typing import Any

from rock2d.errors import InputError
from rock2d.files.checked_yaml import did_you_mean, yaml_text
from rock2d.files.places import DataPath, number_at, place_of, places_of_numbers, value_at
from rock2d.files.scenario import Scenario
from rock2d.files.scenario_reading import checked_scenario


def variant(scenario: Scenario, values: Mapping[str, float], *, uncertain: bool = False) -> Scenario:
    """The scenario with other numbers at these places, checked.

    Parameters
    ----------
    values : place -> number, for example ``{"embankment.height_m": 4.0}``
    uncertain : keep the key ``uncertainty``; by default it is removed

    Raises
    ------
    InputError
        If there is no number at a place, or if a value makes no sense.

    Examples
    --------
    >>> import rock2d
    >>> from rock2d.files.scenario import scenario_file
    >>> site = rock2d.load_scenario(scenario_file("design_site.yaml"))
    >>> rock2d.variant(site, {"embankment.height_m": 5.0}).embankment.height_m
    5.0"""
    document, data = scenario.document, copy.deepcopy(scenario.document.data)
    if not uncertain:
        data.pop("uncertainty", None)
    diagnosed = scenario.diagnosed
    if diagnosed is not None:
        found = {place: value for place, value in values.items() if place in diagnosed.unknown()}
        diagnosed = diagnosed.with_values(found)
        values_of_file = {place: value for place, value in values.items() if place not in found}
    else:
        values_of_file = dict(values)
    for place, value in values_of_file.items():
        path = place_of(data, place)
        if path is None or number_at(data, place) is None:
            message = f"there is no number at {place}{did_you_mean(place, places_of_numbers(data))}"
            if (part := place.partition(".")[0]) not in data:
                message += f"; the file has no key {part}"
            raise document.error(message, *place.split("."), code="unknown_name")
        here = value_at(data, path[:-1])
        whole = isinstance(here[path[-1]], int) and float(value).is_integer()
        here[path[-1]] = int(value) if whole else float(value)
    try:
        return checked_scenario(
            document.with_data(data), scenario.experiment, diagnosed=diagnosed, terrain=scenario.terrain
        )
    except InputError as error:
        drawn = ", ".join(f"{place} = {value:.6g}" for place, value in values.items())
        raise InputError(
            f"{error.message}; with {drawn}", error.file, error.line, error.column, code=error.code
        ) from None


def with_change(scenario: Scenario, change: Callable[[dict[str, Any]], Any]) -> Scenario:
    """The scenario whose data `change` has changed, checked, without the key ``uncertainty`` and without scatter of
    numbers that the change removes. Raises InputError as `variant` does."""
    data = copy.deepcopy(scenario.document.data)
    change(data)
    data.pop("uncertainty", None)
    if "scatter" in data:
        data["scatter"] = {p: varied for p, varied in data["scatter"].items() if number_at(data, p) is not None}
    document = scenario.document.with_data(data)
    return checked_scenario(document, scenario.experiment, diagnosed=scenario.diagnosed, terrain=scenario.terrain)


def with_numbers(scenario: Scenario, values: Mapping[str, float]) -> Scenario:
    """The scenario with other numbers at these places under `model` and `blocks`, for one release. The scenario is not
    checked again; parameters and blocks that are made from it are."""
    changed = scenario
    for place, value in values.items():
        path = place_of(scenario.document.data, place)
        assert path is not None  # checked with the file
        changed = _replaced(changed, path, value)
    return changed


def _replaced(here: Any, path: DataPath, value: float) -> Any:
    if not path:
        return value
    step, rest = path[0], path[1:]
    if isinstance(here, list):
        return [_replaced(item, rest, value) if i == step else item for i, item in enumerate(here)]
    if isinstance(here, dict):
        return {**here, step: _replaced(here[step], rest, value)}
    key = str(step)
    return here.model_copy(update={key: _replaced(getattr(here, key), rest, value)})


def scenario_text(scenario: Scenario) -> str:
    """The scenario as the text of a YAML file from which it is loaded again."""
    return yaml_text(scenario.document.data, width=120)
