"""diagnosis.json: one record for all that is written and for all who read it."""

import json
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rock2d.diagnosis.command import run_comparison
from rock2d.diagnosis.levers import DEPENDENCES, FRAME, LEVER_SIZES, LEVERS
from rock2d.diagnosis.predict import diagnosed_world, learnt_changes, read_for_prediction
from rock2d.diagnosis.quantities import Basis, bases, quantities_of, waves
from rock2d.effects import catalogue
from rock2d.errors import InputError, ParameterError
from rock2d.files.diagnosis import diagnosis_text
from rock2d.laws.contact import MU, ContactParameters
from rock2d.schemas import file_schema
from tests.diagnosed_files import GAIN, SOIL, content, diagnosed, effect, with_learnt
from tests.kinematics.synthetic_films import world
from tests.programs import refusal

SCHEMA = jsonschema.Draft202012Validator(file_schema("diagnosis"))
BORDERS = ({"k_t_N_m": 0.0}, {"k_r_Nm_rad": 0.0}, {"friction_angle_deg": 0.0}, {"friction_angle_deg": 90.0},
           {"k_ul_N_m": SOIL["k_l_N_m"]})  # fmt: skip


def read_by_all(folder: Path, given: dict[str, Any]) -> dict[str, Any]:
    """The content as `predict` reads it, after a scenario and a comparison have read the same file."""
    diagnosed(folder, given)
    run_comparison(folder / "d.json", folder / "d.json", folder / "out", report=lambda line: None)
    return read_for_prediction(folder / "d.json")


def learnt(lever: str, *found: tuple[Basis, np.ndarray]) -> dict[str, Any]:
    """A diagnosis with learnt changes: bases and coefficients."""
    changes = (basis.content() | {"lever": lever, "coefficients": own.tolist()} | GAIN for basis, own in found)
    return content("unknown", schema=2, model=with_learnt(SOIL, *changes))


def test_why_nothing_can_be_predicted_is_told(tmp_path):
    faults = {"faults": ["1 release is too few"], "fault_codes": ["few_releases"], "remarks": []}
    (tmp_path / "d.json").write_text(json.dumps(content("unknown") | {"base": {}, "sanity": faults}))
    said = "no fitted law: 1 release is too few"
    assert refusal(read_for_prediction, tmp_path / "d.json", said=said).code == "missing_key"


@pytest.mark.parametrize("lever", LEVERS)
def test_all_read_every_change_that_can_be_learnt(tmp_path, lever):
    rng = np.random.default_rng(1)
    dependences = DEPENDENCES[lever]
    measured = {name: rng.integers(0, 40, 200).astype(float) for name in quantities_of(dependences)}
    own = list(bases(dependences, measured).values())
    assert len(own) == len(dependences)
    own += waves(np.linspace(0.0, 1.0, 50), 0.1)[:1] if lever == FRAME else []
    widths = [basis.features({**measured, "time_s": np.zeros(1)}).shape[1] for basis in own]
    for size in LEVER_SIZES[lever]:
        given = learnt(lever, *((basis, rng.normal(size=(size, k))) for basis, k in zip(own, widths, strict=True)))
        SCHEMA.validate(json.loads(diagnosis_text(given)))
        assert [change.basis for change in learnt_changes(read_by_all(tmp_path, given))] == own


def test_a_change_that_its_lever_cannot_follow_is_refused_with_its_place(tmp_path):
    (constant,) = bases({"nothing": ()}, {}).values()
    height = {"quantity": "height_above_ground_m", "kind": "line", "numbers": [1.0]}
    for change, place in (({"curves": [height]}, "quantity"), ({"coefficients": [[1.0]]}, "coefficients")):
        given = learnt("law", (constant, np.zeros((5, 1))))
        given["model"]["learnt"]["changes"][0] |= change
        (tmp_path / "d.json").write_text(json.dumps(given, indent=1))
        error = refusal(read_for_prediction, tmp_path / "d.json", said=rf"model\.learnt\.changes\.0\..*{place}: ")
        assert place in (tmp_path / "d.json").read_text().split("\n")[error.line - 1]


@pytest.mark.parametrize("name", catalogue())
def test_all_read_every_effect(tmp_path, name):
    values = {q.name: (q.choices[0] if q.choices else q.neutral,) * 3 for q in catalogue()[name].parameters}
    given = content(name, {name: effect(**values)})
    SCHEMA.validate(json.loads(diagnosis_text(given)))
    diagnosed_world(read_by_all(tmp_path, given), world(), np.zeros(1), base_only=False)


@pytest.mark.parametrize("border", BORDERS)
def test_a_soil_at_the_border_of_the_law_is_read_by_all_and_simulated(tmp_path, border):
    read = read_by_all(tmp_path, content(base={**SOIL, **border}))
    row = ContactParameters(**read["base"]).row()
    assert diagnosed_world(read, world(), np.zeros(1), base_only=True).contact[0, 0, MU] == row[MU]


NUMBERS = st.sampled_from([-1.0, 0.0, 1e-3, 30.0, 90.0, 90.1, 1e4, 1e6])


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(st.fixed_dictionaries(dict.fromkeys(SOIL, NUMBERS)))
def test_a_soil_is_legal_for_all_or_for_none(tmp_path, soil):
    try:
        ContactParameters(**soil)
        legal = True
    except ParameterError:
        legal = False
    (tmp_path / "d.json").write_text(json.dumps(content(base=soil)))
    for read in (
        lambda: read_for_prediction(tmp_path / "d.json"),
        lambda: diagnosed(tmp_path, content(base=soil)),
        lambda: run_comparison(tmp_path / "d.json", tmp_path / "d.json", tmp_path / "out", report=print),
    ):
        if legal:
            read()
        else:
            with pytest.raises(InputError):
                read()


def test_what_a_reader_would_refuse_is_not_written():
    with pytest.raises(ValueError, match="holds the value"):
        diagnosis_text(content("air_drag", {"air_drag": effect(drag_per_mass_1_m=(0.5, 0.1, 0.2))}))
    with pytest.raises(ValueError, match="a key that its schema does not describe"):
        diagnosis_text(content(moon={"phase": "full"}))


def test_a_file_of_schema_1_may_give_no_law_to_an_effect(tmp_path):
    given = content("air_drag", {"air_drag": effect(drag_per_mass_1_m=(0.01, 0.0, 0.02))})
    del given["effects"]["air_drag"]["base"]
    assert read_by_all(tmp_path, given)["effects"]["air_drag"]["base"] == SOIL
