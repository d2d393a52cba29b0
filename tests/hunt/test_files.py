"""A small hunt with a fixed seed: damaged files end with a result or one clear message."""

import json

import jsonschema
import pytest

from rock2d.schemas import file_schema
from tests.hunt.mutations import mutant
from tests.hunt.trials import ACCEPTED, FAILED, KINDS, Outcome, tried
from tests.hunt.valid_files import diagnoses

# what one of fifty damaged scenarios does is met with 96 %; those that take longest are fewest
COUNTS = {"scenario": 160, "experiment": 30, "diagnosis": 120}


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_damaged_is_valid(kind):
    for files in KINDS[kind].sources():
        outcome = tried(kind, files, use=kind == "diagnosis")
        assert outcome.what == ACCEPTED or "too few" in outcome.text, outcome.text


def test_the_diagnoses_are_as_the_schema_says():
    for files in diagnoses():
        jsonschema.validate(json.loads(files["diagnosis.json"]), file_schema("diagnosis"))


@pytest.mark.parametrize("kind", KINDS)
def test_damaged_files_end_with_a_result_or_one_clear_message(kind):
    sources = KINDS[kind].sources()[:3]
    found: dict[str, Outcome] = {}
    for number in range(COUNTS[kind]):
        name = f"{kind}/0/{number}"
        found[name] = tried(kind, mutant(name, sources).files(sources), use=False)
    assert not {name: outcome.text for name, outcome in found.items() if outcome.what == FAILED}
    assert {outcome.what for outcome in found.values()} == {"accepted", "refused"}


def test_a_mutant_is_made_again_by_its_name_and_smaller_ones_have_fewer_changes():
    sources = KINDS["scenario"].sources()
    names = [f"scenario/7/{number}" for number in range(20)]
    mutants = [mutant(name, sources) for name in names]
    assert mutants == [mutant(name, sources) for name in names]
    large = max(mutants, key=lambda own: len(own.changes))
    assert large.files(sources) == large.files(sources) != sources[large.source]
    assert [len(fewer.changes) for fewer in large.smaller()] == sorted(
        len(f.changes) for f in large.smaller()
    )
