"""Scenarios that differ from a given one in single numbers, each named by its place: `embankment.height_m`."""

from __future__ import annotations

import copy
import io
from collections.abc import Mapping

from rock2d.errors import InputError
from rock2d.files.places import number_at, place_of
from rock2d.files.scenario import Scenario, checked_scenario


def variant(scenario: Scenario, values: Mapping[str, float]) -> Scenario:
    """The scenario with other numbers at these places, checked, and without what is not known.

    Raises InputError where there is no number, or where a value makes no sense.
    """
    document = scenario.document
    if document is None:
        raise InputError("a scenario that was not read from a file has no variants", code="wrong_kind")
    data = copy.deepcopy(document.data)
    data.pop("uncertainty", None)
    for place, value in values.items():
        if number_at(data, place) is None:
            raise document.error(f"there is no number at {place}", *place_of(place), code="unknown_name")
        *parents, last = place_of(place)
        here = data
        for step in parents:
            here = here[step]
        here[last] = int(value) if isinstance(here[last], int) and float(value).is_integer() else float(value)
    try:
        return checked_scenario(document.with_data(data), scenario.experiment)
    except InputError as error:
        drawn = ", ".join(f"{place} = {value:.6g}" for place, value in values.items())
        raise InputError(
            f"{error.message}; that is with {drawn}", error.file, error.line, error.column, code=error.code
        ) from None


def scenario_text(scenario: Scenario) -> str:
    """The scenario as the text of a YAML file from which it is loaded again."""
    from ruamel.yaml import YAML

    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = None
    yaml.width = 120
    yaml.sort_base_mapping_type_on_output = None  # keep the order of the keys
    document = scenario.document
    assert document is not None
    stream = io.StringIO()
    yaml.dump(document.data, stream)
    return stream.getvalue()
