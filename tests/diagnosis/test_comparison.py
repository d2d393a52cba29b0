"""Two diagnoses side by side: agreement is judged, what cannot be compared is named, a bad file writes nothing."""

import base64
import io
import json

import pandas as pd
import pytest

from rock2d.diagnosis.command import run_comparison
from rock2d.diagnosis.comparison import agree
from rock2d.effects import catalogue
from rock2d.errors import InputError
from rock2d.files.fitted_keys import FittedParameter
from tests import diagnosed_files
from tests.diagnosed_files import CLOSED, GAIN
from tests.diagnosis.test_report import Page
from tests.programs import commanded, refusal

NASTY = "<script>alert(1)</script> & $co$"


def diagnosis(verdict: str = "camera_tilt", tilt: float = -0.035, half: float = 0.001, **changes) -> dict:
    """A small diagnosis.json."""
    chances = dict.fromkeys(("none", "unknown", *catalogue()), 0.001) | {verdict: 0.9}
    closed = {**GAIN, **CLOSED}
    tilts = {"tilt_rad": {"value": tilt, "ci95": [tilt - half, tilt + half], "unit": "rad"}}
    drags = {"drag_per_mass_1_m": {"value": 0.1, "ci95": [0.1, 0.1], "unit": "1/m"}}
    effects = {"camera_tilt": {"parameters": tilts, **closed}, "air_drag": {"parameters": drags, **closed}}
    where = [
        {"phase": "flight", "zone": "ditch", "block": "cube", "channel": "x", "share": 0.7, "z": 9.0},
        {"phase": "impact", "zone": "crest", "block": "cube", "channel": "spin", "share": 0.3, "z": 3.0},
    ]
    sanity = {"faults": [], "remarks": []}
    more = {"probabilities": chances, "where": where, "next_release": "A cube.", "sanity": sanity, **changes}
    return diagnosed_files.content(verdict, effects) | more


def not_diagnosed() -> dict:
    gap = dict.fromkeys(("base", "augmented", "noise_floor", "closure", "closure_ci95"))
    return diagnosis(
        "unknown", base={}, effects={}, where=[], group=[], gap={"unit": "noise", **gap},
        sanity={"faults": ["only 2 releases"], "remarks": []}, next_release="",
    )  # fmt: skip


@pytest.fixture
def compared(tmp_path):
    """Compare two contents; returns comparison.json, the page, and the lines for the terminal."""

    def compare(a: dict, b: dict) -> tuple[dict, str, list[str]]:
        (tmp_path / "a").mkdir(exist_ok=True)
        (tmp_path / "a" / "diagnosis.json").write_text(json.dumps(a), encoding="utf-8")
        (tmp_path / "b.json").write_text(json.dumps(b), encoding="utf-8")
        lines: list[str] = []
        run_comparison(tmp_path / "a", tmp_path / "b.json", tmp_path / "out", report=lines.append)
        content = json.loads((tmp_path / "out" / "comparison.json").read_text(encoding="utf-8"))
        return content, (tmp_path / "out" / "comparison.html").read_text(encoding="utf-8"), lines

    return compare


def value(middle: float, low: float, high: float) -> FittedParameter:
    return FittedParameter(value=middle, ci95=[low, high], unit="1")


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        (value(1.0, 0.8, 1.2), value(1.1, 0.9, 1.3), True),
        (value(1.0, 0.9, 1.1), value(1.3, 1.2, 1.4), False),
        (value(1.0, 0.9, 1.1), value(1.14, 1.04, 1.24), True),  # 0.14 < hypot(0.1, 0.1)
        (value(1.0, 0.9, 1.1), value(1.15, 1.05, 1.25), False),
        (value(1.0, 0.1, 1.1), value(1.3, 1.2, 9.0), False),  # wide only on the sides that look away
        (value(1.0, 1.0, 1.0), value(1.0, 1.0, 1.0), True),
        (value(1.0, 1.0, 1.0), value(2.0, 2.0, 2.0), None),  # no interval is stated
    ],
)
def test_values_agree_within_their_uncertainty(a, b, expected):
    assert agree(a, b) is expected
    assert agree(b, a) is expected


def test_parameters_of_the_verdicts_are_judged(compared):
    content, page, lines = compared(diagnosis(), diagnosis(tilt=-0.030))
    [tilt] = [row for row in content["parameters"] if row["parameter"] == "tilt_rad"]
    assert tilt["of_interest"] and tilt["agree"] is False
    assert (tilt["a"]["value"], tilt["b"]["value"]) == (-0.035, -0.030)
    assert any(line.startswith("camera_tilt.tilt_rad") and line.endswith("differ") for line in lines)
    content, page, _ = compared(diagnosis(), diagnosis(tilt=-0.0352))
    assert content["parameters"][0]["agree"] is True and content["verdict"]["same"]
    assert "The same verdict" in page and ">agree<" in page


def test_different_verdicts_probabilities_and_places_stand_side_by_side(compared):
    other = diagnosis("air_drag")
    other["where"] = [{**other["where"][0], "share": 1.0}]
    content, page, lines = compared(diagnosis(), other)
    assert content["verdict"] == {"a": "camera_tilt", "b": "air_drag", "same": False}
    assert content["group"] == {"a": ["camera_tilt"], "b": ["air_drag"], "common": []}
    chances = {row["name"]: (row["a"], row["b"]) for row in content["probabilities"]}
    assert chances["air_drag"] == (0.001, 0.9) and set(chances) == {"none", "unknown", *catalogue()}
    shares = {(row["zone"], row["channel"]): (row["a"], row["b"]) for row in content["where"]}
    assert shares == {("ditch", "x"): (0.7, 1.0), ("crest", "spin"): (0.3, 0.0)}
    assert "Different verdicts" in page
    assert any(line.split() == ["p(air_drag)", "less", "than", "1", "%", "90", "%"] for line in lines)
    assert any("Only in A: crest" in note for note in content["notes"])


def test_what_cannot_be_compared_is_said(compared):
    same = compared(diagnosis(), diagnosis())[0]["notes"]
    assert len(same) == 1 and "do not show whether both are of the same film" in same[0]
    content, page, lines = compared(diagnosis(), diagnosis(experiment="other", schema=2))
    assert any(note.startswith("The experiments differ") for note in content["notes"])
    assert any("different schemas, 1 and 2" in note for note in content["notes"])
    for note in content["notes"]:
        assert f"note: {note}" in lines and note in Page(page).text
    newer = compared(diagnosis(), diagnosis(schema=7))[0]["notes"]
    assert any("Schema 7 is newer" in note for note in newer)


def test_keys_of_later_schemas_are_ignored(compared):
    later = {"floor": {"regression": 1.0, "replicates": 1.0, "used": 1.0}, "moon": {"phase": "full"}}
    plain, _, _ = compared(diagnosis(), diagnosis(schema=2))
    more, _, _ = compared(diagnosis(), diagnosis(schema=2, **later))
    assert plain == more


def test_an_experiment_that_was_not_diagnosed_is_not_compared(compared):
    content, page, lines = compared(diagnosis(), not_diagnosed())
    assert content["diagnosed"] == {"a": True, "b": False}
    assert any("B could not be diagnosed (only 2 releases)" in note for note in content["notes"])
    assert "not diagnosed" in Page(page).text and any("not diagnosed" in line for line in lines)
    assert compared(not_diagnosed(), not_diagnosed())[0]["parameters"] == []


def test_effects_beside_the_verdict_are_named(compared):
    one = diagnosis()
    beside = {"effect": "air_drag", "base": one["base"], "parameters": {}, **GAIN}
    content, page, _ = compared({**one, "beside": [beside]}, one)
    assert content["beside"] == {"a": ["air_drag"], "b": []}
    assert "found as well" in page and any("each effect alone" in note for note in content["notes"])


def test_page_needs_no_network_and_escapes_what_files_say(compared):
    nasty = diagnosis(experiment=NASTY, next_release=NASTY)
    nasty["where"][0]["zone"] = NASTY
    _, text, lines = compared(nasty, diagnosis(experiment="bell\x07"))
    page = Page(text)
    assert page.needs_no_network()
    assert "http://" not in text and "https://" not in text and "<script>" not in text
    assert page.text.count(NASTY) >= 3
    assert not any("\x07" in line for line in lines)
    levels = [int(tag[1]) for tag in page.tags if tag in ("h1", "h2", "h3", "h4")]
    assert levels.count(1) == 1 and max(levels) == 3 and page.of("html") == [{"lang": "en"}]
    assert "rock2d compare" in page.text and "@media print" in text and "max-width: 760px" in text


def test_tables_of_the_page_can_be_downloaded(compared):
    content, text, _ = compared(diagnosis(), diagnosis("air_drag", tilt=-0.03))
    tables = {
        link["download"]: pd.read_csv(io.BytesIO(base64.b64decode(link["href"].split(",")[1])))
        for link in Page(text).of("a")
    }
    assert set(tables) == {"probabilities.csv", "parameters.csv", "law.csv", "closures.csv", "where.csv"}
    tilt = tables["parameters.csv"].set_index("parameter").loc["tilt_rad"]
    assert (tilt["a"], tilt["b_low95"]) == (-0.035, -0.031)
    assert len(tables["where.csv"]) == len(content["where"])


def test_the_same_comparison_gives_the_same_files(compared, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    first = compared(diagnosis(), diagnosis("air_drag"))
    assert compared(diagnosis(), diagnosis("air_drag")) == first


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        (None, "No such file"),
        ("{", "not JSON"),
        ("[]", "expected a diagnosis.json"),
        ('{"name": 1}', "expected a diagnosis.json"),
        (json.dumps(diagnosis(group=3)), "group: expected a list, found 3"),
        (json.dumps(diagnosis(schema=0)), "schema"),
        (json.dumps(diagnosis(verdict="camera_tilt", probabilities={"none": 1.0})), "probability of the verdict"),
        (json.dumps(diagnosis(tilt=float("inf"))), "finite"),
        (json.dumps({k: v for k, v in diagnosis().items() if k != "gap"}), "missing key 'gap'"),
    ],
)
def test_a_bad_file_is_one_message_and_nothing_is_written(tmp_path, bad, words):
    good, file, out = tmp_path / "good.json", tmp_path / "bad.json", tmp_path / "out"
    good.write_text(json.dumps(diagnosis()), encoding="utf-8")
    if bad is not None:
        file.write_text(bad, encoding="utf-8")
    before = sorted(tmp_path.iterdir())
    for arguments in ([good, file], [file, good]):
        error = commanded("compare", *arguments, "--out", out).exception
        assert isinstance(error, InputError)  # `main` ends with exit code 2
        assert str(file) in str(error) and words in str(error)
        assert len(str(error).splitlines()) == 1
        assert sorted(tmp_path.iterdir()) == before


def test_a_foreign_folder_is_not_replaced(tmp_path):
    good, out = tmp_path / "good.json", tmp_path / "out"
    good.write_text(json.dumps(diagnosis()), encoding="utf-8")
    out.mkdir()
    (out / "thesis.txt").write_text("years of work", encoding="utf-8")
    assert refusal(run_comparison, good, good, out, report=print).code == "not_a_result"
    assert [path.name for path in out.iterdir()] == ["thesis.txt"]


def test_a_folder_stands_for_its_diagnosis(tmp_path):
    (tmp_path / "diagnosis.json").write_text(json.dumps(diagnosis()), encoding="utf-8")
    content = run_comparison(tmp_path, tmp_path, tmp_path / "out", report=lambda line: None)
    assert content["files"]["a"] == str(tmp_path / "diagnosis.json")
    error = refusal(run_comparison, tmp_path, tmp_path / "nowhere", tmp_path / "out", report=print)
    assert error.code == "missing_file"
