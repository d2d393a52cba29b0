"""Tutorials run, with few releases; the diagnosis that one makes obeys the schema of diagnosis.json."""

import re

import matplotlib
import pytest
from jsonschema import Draft202012Validator

from rock2d.schemas import SCHEMAS, file_schema
from tests.docs.sources import ROOT, generator

FEW = {"ensemble": 20, "diagnosis": 6}  # releases of each block


def run_tutorial(name: str, folder, monkeypatch) -> dict:
    """The names that a tutorial leaves, run in a folder of its own."""
    path = ROOT / "docs" / "tutorials" / f"{name}.py"
    source = path.read_text(encoding="utf-8")
    if name in FEW:
        source, count = re.subn(r"^RELEASES = \d+", f"RELEASES = {FEW[name]}", source, flags=re.MULTILINE)
        assert count == 1
    (folder / "scenarios").symlink_to(ROOT / "scenarios")
    monkeypatch.chdir(folder)
    matplotlib.use("Agg")
    scope: dict = {"__name__": "__main__"}
    exec(compile(source, str(path), "exec"), scope)
    return scope


@pytest.mark.parametrize("name", [p.stem for p in generator().tutorial_files() if p.stem != "diagnosis"])
def test_tutorial_runs(name, tmp_path, monkeypatch, capsys):
    run_tutorial(name, tmp_path, monkeypatch)
    assert capsys.readouterr().out
    assert list(tmp_path.glob("*.png"))


def test_diagnosis_tutorial_finds_the_tilt_and_obeys_the_schema(tmp_path, monkeypatch, capsys):
    scope = run_tutorial("diagnosis", tmp_path, monkeypatch)
    content = scope["found"].to_dict()
    assert content["verdict"] == "camera_tilt"
    value = content["effects"]["camera_tilt"]["parameters"]["tilt_rad"]["value"]
    assert value == pytest.approx(scope["tilt"], rel=0.1)
    assert content["gap"]["closure"] > 0.85
    assert sum(content["probabilities"].values()) == pytest.approx(1.0)
    assert content["where"] and sum(c["share"] for c in content["where"]) == pytest.approx(1.0)
    schema = file_schema("diagnosis")
    Draft202012Validator(schema).validate(content)
    assert set(content) <= set(schema["properties"]), "a key of diagnosis.json is not in its schema"
    refused = content | {"verdict": 3}
    assert not Draft202012Validator(schema).is_valid(refused)


@pytest.mark.parametrize("kind", SCHEMAS)
def test_schema_is_a_schema(kind):
    Draft202012Validator.check_schema(file_schema(kind))


def test_schemas_accept_real_files():
    from ruamel.yaml import YAML

    for path in generator().scenario_files():
        Draft202012Validator(file_schema("scenario")).validate(YAML(typ="safe").load(path))
