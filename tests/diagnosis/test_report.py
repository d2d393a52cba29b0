"""The report: one page that needs no network, states the verdict, and never runs code from a name."""

import base64
import io
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import rock2d
from rock2d.diagnosis.command import run_diagnosis
from rock2d.diagnosis.diagnose import Diagnosis, diagnose
from rock2d.diagnosis.diagnosis_content import diagnosis_json
from rock2d.diagnosis.report import page
from rock2d.diagnosis.report.text import predicted_words, share_closed, size_words
from rock2d.effects import catalogue
from rock2d.effects.effect import Effect
from rock2d.errors import InputError
from rock2d.files.experiment import Experiment
from rock2d.graphics.bar_charts import NARROW_LABEL, WIDE_LABEL, Axis, tick_labels
from rock2d.graphics.pages import download
from rock2d.graphics.rendering import Made, coded
from rock2d.kinematics.sanity import Fault, Sanity
from rock2d.kinematics.setup_world import setup_world
from rock2d.kinematics.states import move_freely
from rock2d.progress import Bars
from tests.browsing import assert_only_its_own_script_may_run
from tests.kinematics.synthetic_films import coarse_fits, effects, film, series_order, world

NAME = "<script>alert(1)</script> & $co$"
RELEASES = 6  # per block: as few as can be diagnosed
EFFECTS = effects("camera_tilt", "inertia_error")


class Page(HTMLParser):
    """Tags, what they refer to, and the text of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, dict[str, str | None]]] = []
        self.references: list[str] = []
        self.text = ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes.append((tag, dict(attrs)))
        assert not [name for name, _ in attrs if name.startswith("on")], "a handler runs code"
        self.references += [
            value for name, value in attrs if name in ("src", "href", "data", "action", "srcset", "poster")
        ]

    def handle_data(self, data):
        self.text += data.replace("\N{NO-BREAK SPACE}%", " %")

    def needs_no_network(self, scripts: int = 0) -> bool:
        """Nothing on it but so many scripts is code or a frame, and all that it shows is in it."""
        assert self.tags.count("script") == scripts
        assert not {"link", "iframe", "object", "embed", "base", "form"} & set(self.tags)
        return bool(self.references) and all(ref.startswith("data:") for ref in self.references)

    def of(self, tag: str) -> list[dict[str, str | None]]:
        """The attributes of every element of this kind."""
        return [attributes for name, attributes in self.attributes if name == tag]


def quick(experiment: Experiment, **tried: Effect) -> Diagnosis:
    """A diagnosis with coarse fits: enough to test the page."""
    with coarse_fits():
        return diagnose(experiment, effects=tried)


@pytest.fixture(scope="module")
def diagnosed() -> Diagnosis:
    true = catalogue()["camera_tilt"].apply(world(series_order(RELEASES)), [0.03, 0.0, 0.0])
    experiment = replace(film(true, RELEASES, seed=5, fps=500.0, duration_s=0.3), name=NAME)
    return quick(experiment, **EFFECTS)


def write(result: Diagnosis, folder: Path) -> tuple[Page, str]:
    """Write the report of a diagnosis on a day of 1970; returns the page and its text."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SOURCE_DATE_EPOCH", "86400")
        command = "rock2d diagnose <x> --out y"
        page.write_report(result, diagnosis_json(result), folder, bars=Bars(False), command=command)
    text = (folder / "report.html").read_text(encoding="utf-8")
    return Page(text), text


@pytest.fixture
def written(tmp_path):
    """Write the report of a diagnosis into a folder of its own; returns the page and its text."""
    return lambda result: write(result, tmp_path)


@pytest.fixture(scope="module")
def report(diagnosed, tmp_path_factory) -> tuple[Page, str, Path]:
    """The report of `diagnosed`: page, text and folder. Tests must not change them."""
    folder = tmp_path_factory.mktemp("report")
    return *write(diagnosed, folder), folder


def with_verdict(result: Diagnosis, verdict: str) -> Diagnosis:
    """The same diagnosis with another verdict."""
    chances = dict.fromkeys(result.found.probabilities, 0.02) | {verdict: 0.9}
    return replace(result, found=replace(result.found, probabilities=chances))


def test_page_needs_no_network_and_runs_nothing(report):
    page, text, _ = report
    assert page.needs_no_network(scripts=2)  # data and the script of the live view
    assert_only_its_own_script_may_run(text)
    assert "http://" not in text and "https://" not in text and "url(" not in text
    assert "default-src 'none'" in text
    assert NAME in page.text and "<script>alert" not in text
    assert len(text) < 8e6


def test_page_says_cause_place_and_closure(diagnosed, report):
    page, text, folder = report
    content = diagnosis_json(diagnosed)
    assert content["verdict"] == "camera_tilt"
    assert "Camera tilt" in page.text and EFFECTS["camera_tilt"].summary in page.text
    gap = content["gap"]
    assert share_closed(gap["closure"], gap["closure_ci95"]) in page.text
    assert "inertia error" in page.text  # the runner-up
    for words in ("Where the simulation is wrong", "Passing frequency", "uphill face", "Assumptions of this diagnosis"):
        assert words in page.text
    assert page.tags.count("img") == 8  # the cross-section, six impacts, the still of the video
    video = (folder / "side_by_side.webm").read_bytes()
    assert base64.b64encode(video).decode() in text


def test_headings_language_and_title_are_those_of_one_document(report):
    page, text, _ = report
    levels = [int(tag[1]) for tag in page.tags if tag in ("h1", "h2", "h3", "h4", "h5", "h6")]
    assert levels[0] == 1 and levels.count(1) == 1 and max(levels) == 3
    assert all(below <= above + 1 for above, below in pairwise(levels))
    assert page.of("html") == [{"lang": "en"}]
    assert "<title>Diagnosis of &lt;script&gt;" in text and ": Camera tilt</title>" in text


def test_every_figure_says_what_it_shows(diagnosed, report):
    page, _, _ = report
    section, *impacts, still = [image["alt"] for image in page.of("img")]
    content = diagnosis_json(diagnosed)
    shares = {}
    for cell in content["where"]:
        if cell["z"] >= 2.0:
            shares[cell["zone"]] = shares.get(cell["zone"], 0.0) + cell["share"]
    largest = max(shares, key=shares.get)
    assert f"{largest.replace('_', ' ')} {100 * shares[largest]:.0f} %" in section
    assert len(set(impacts)) == 6
    for alt in impacts:
        assert re.search(r"base law \d+\.\d mm and \d+\.\d°, with camera tilt \d+\.\d mm", alt)
    assert still.startswith("Still of the video") and "from the film" in still
    for strip in page.of("svg"):
        assert strip.get("aria-label") or strip.get("aria-hidden") or "overflow" in strip


def test_the_video_has_a_still_and_a_text(report):
    page, text, _ = report
    [video] = page.of("video")
    kind, still = video["poster"].split(",")
    assert kind == "data:image/png;base64" and base64.b64decode(still).startswith(b"\x89PNG")
    assert f'id="{video["aria-describedby"]}"' in text
    assert "times slower than the film: measured, base law, with camera tilt" in page.text


def test_the_data_of_every_figure_can_be_downloaded(diagnosed, report):
    page, _, _ = report
    tables = {}
    for link in page.of("a"):
        kind, coded = link["href"].split(",", 1)
        assert kind == "data:text/csv;charset=utf-8;base64"
        tables[link["download"]] = pd.read_csv(io.BytesIO(base64.b64decode(coded)))
    content = diagnosis_json(diagnosed)
    chances = tables["probabilities.csv"].set_index("answer")["probability"]
    assert chances.to_dict() == pytest.approx(content["probabilities"], rel=1e-5)
    assert tables["gap.csv"]["base"][0] == pytest.approx(content["gap"]["base"], rel=1e-5)
    assert len(tables["where.csv"]) == len(content["where"])
    assert len(tables["impacts.csv"]) == len(diagnosed.data.impact_release)
    assert len([name for name in tables if re.fullmatch(r"impact_\d\.csv", name)]) == 6
    assert {"base law", "with camera tilt", "measured"} == set(tables["impact_1.csv"]["series"])
    fitted = tables["parameters.csv"].set_index(["model", "parameter"])["value"]
    tilt = content["effects"]["camera_tilt"]["parameters"]["tilt_rad"]["value"]
    assert fitted["camera_tilt", "tilt_rad"] == pytest.approx(tilt, rel=1e-5)
    assert {"passing_frequency.csv", "flights.csv", "video.csv", "gains.csv"} <= set(tables)


def test_a_cell_is_no_formula_of_a_spreadsheet():
    link = download("x.csv", ("a", "b", "c"), [("=1+1", 2.0, None), ("-cube", float("nan"), 3)])
    text = base64.b64decode(link.href.split(",")[1]).decode()
    assert text == "a,b,c\n'=1+1,2,\n'-cube,,3\n" and link.rows == 2


def test_page_says_when_and_how_it_was_made_and_is_the_same_again(diagnosed, report, written):
    again, content = written(diagnosed)[1], diagnosis_json(diagnosed)
    # a video has numbers of its own
    texts = [re.sub(r"data:video/webm;base64,[^\"]*", "", text) for text in (report[1], again)]
    assert texts[0] == texts[1]
    said = report[0].text
    assert "1970-01-02 00:00 UTC" in said and "rock2d diagnose <x> --out y" in said
    assert rock2d.__version__ in said and "0 (of the bootstrap intervals)" in said
    assert "1970-01" not in json.dumps(content)


def test_backticks_become_code_and_everything_is_escaped():
    assert coded("a `<b>` <i>\nx") == "a <code>&lt;b&gt;</code> &lt;i&gt;<br>x"


def test_no_screen_shows_tick_labels_that_overlap():
    labels = tick_labels(Axis(-590.0, 6000.0, 10.0))
    places = [float(x) for x in re.findall(r"x=.([\d.]+)%", labels)]
    assert len(places) >= 4 and min(b - a for a, b in pairwise(places)) >= WIDE_LABEL
    shown = [float(x) for kind, x in re.findall(r"<text( class=.tight.)? x=.([\d.]+)%", labels) if not kind]
    assert len(shown) >= 2 and min(b - a for a, b in pairwise(shown)) >= NARROW_LABEL
    assert ">0</text>" in re.sub(r"<text class=.tight.[^/]*/text>", "", labels)  # zero is always there


def test_a_date_that_is_none_is_refused_before_the_work(monkeypatch, tmp_path):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "yesterday")
    with pytest.raises(InputError, match="SOURCE_DATE_EPOCH"):
        run_diagnosis(
            tmp_path / "film", tmp_path / "out", seed=0, workers=1, progress=False, report=print
        )  # fmt: skip
    assert not list(tmp_path.iterdir())
    monkeypatch.delenv("SOURCE_DATE_EPOCH")
    assert Made.now("rock2d", None).date.endswith("UTC")


def test_the_page_says_what_to_do(diagnosed, report):
    _, text, _ = report
    tilt = np.rad2deg(diagnosis_json(diagnosed)["effects"]["camera_tilt"]["parameters"]["tilt_rad"]["value"])
    found = re.search(r"<code>tilt_deg: (-?[\d.]+)</code>", text)
    assert found and float(found.group(1)) == pytest.approx(tilt, abs=0.01)
    assert text.index("What to do") < text.index("Where the simulation is wrong")


@pytest.mark.parametrize(("verdict", "words"), [("none", "No gap"), ("unknown", "Unknown cause")])
def test_none_and_unknown_name_no_cause(diagnosed, written, verdict, words):
    page, _ = written(with_verdict(diagnosed, verdict))
    assert words in page.text
    assert "This explains the gap" not in page.text
    assert "The impacts with the largest residuals of the base law" in page.text


def test_what_cannot_be_diagnosed_gets_advice_only(written):
    both = film(world(), 2)
    one = both.trajectories[both.trajectories["release"] == 0]
    result = quick(replace(both, name=NAME, trajectories=one), **EFFECTS)
    assert result.found is None
    page, text = written(result)
    assert "too poor to diagnose" in page.text and result.sanity.faults[0].message in page.text
    assert "Film more releases" in page.text
    assert not {"img", "video", "script"} & set(page.tags) and "<script>" not in text


def test_remarks_are_shown_and_escaped(written):
    experiment = film(world(), 2)
    result = Diagnosis(
        experiment,
        Sanity([Fault("length_unit", "a <b>fault</b>")], ["a <i>remark</i>", "is the scale right?"]),
        setup_world(experiment),
    )
    page, _ = written(result)
    assert "a <b>fault</b>" in page.text and "a <i>remark</i>." in page.text
    assert "is the scale right?" in page.text and "?." not in page.text


def test_impact_table_has_no_film(diagnosed, written):
    table = replace(diagnosed.experiment, trajectories=None, impacts=impact_table(diagnosed))
    result = quick(table, **EFFECTS)
    assert result.found is not None
    page, _ = written(result)
    assert "Kinetic energy after an impact" in page.text
    assert "video" not in page.tags
    assert page.tags.count("img") == 1 + len(result.found.learnt.changes)


def impact_table(result: Diagnosis) -> pd.DataFrame:
    """The impacts of a film as a table."""
    data = result.data
    impacts, states = data.impacts, data.states(result.setup).middle
    ends = data.film.t_s[data.flights.last[impacts.before] - 1] - data.flights.middle[impacts.before]
    before = move_freely(result.setup, impacts.block, states[impacts.before], ends)
    after = move_freely(result.setup, impacts.block, states[impacts.after], impacts.begin_s)
    columns = ["x_m", "y_m", "theta_rad", "vx_m_s", "vy_m_s", "omega_rad_s"]
    table = pd.DataFrame(before, columns=columns)
    table[["vx_after_m_s", "vy_after_m_s", "omega_after_rad_s"]] = after[:, 3:]
    table.insert(0, "block", np.array(list(result.experiment.blocks))[impacts.block])
    table.insert(0, "release", data.film.release_names[impacts.release])
    return table


def test_a_shape_without_a_marker_of_its_own_is_drawn():
    from rock2d.diagnosis.report.figures import Misses, section_figure

    base = world()
    blocks = {name: replace(block, shape="hexagon") for name, block in base.blocks.items()}
    misses = Misses(np.array([[0.0, 0.1], [0.1, 0.1]]), np.array([0, 1]), np.array([1.0, 3.0]))
    assert section_figure(base.cross_section, blocks, [], misses, {}).axes


def test_the_legend_of_many_blocks_fits_on_a_phone():
    from rock2d.diagnosis.report.figures import Misses, section_figure

    base = world()
    names = ("circle", "square", "rectangle", "ellipse", "polygon")
    blocks = dict.fromkeys(names, next(iter(base.blocks.values())))
    misses = Misses(np.array([[0.0, 0.1], [0.1, 0.1]]), np.array([0, 4]), np.array([1.0, 3.0]))
    figure = section_figure(base.cross_section, blocks, [], misses, {}, narrow=True)
    figure.draw_without_rendering()
    box = figure.legends[0].get_window_extent()
    assert 0 <= box.x0 < box.x1 <= figure.bbox.width and box.y1 < figure.axes[0].get_window_extent().y0


def test_sizes_have_units_that_a_person_can_use():
    scale, tilt, drag = (catalogue()[name].parameters[0] for name in ("scale_error", "camera_tilt", "air_drag"))
    assert size_words(scale, {"value": 1.041, "ci95": [1.038, 1.044]}) == "+4.10 %"
    assert size_words(scale, {"value": 0.96, "ci95": [0.95, 0.97]}) == "−4.0 %"
    assert size_words(tilt, {"value": 0.0349, "ci95": [0.03, 0.04]}).endswith("°")
    balls = {"light": {"value": 0.042, "ci95": [0.041, 0.043]}, "heavy": {"value": 0.004, "ci95": [0.003, 0.005]}}
    of_blocks = {"value": 0.02, "ci95": [0.019, 0.021], "by_block": balls}
    assert size_words(drag, of_blocks) == "0.0040 1/m to 0.04200 1/m"


def test_misses_are_numbers_without_powers_of_ten():
    miss = {"base": 1013.4, "augmented": 18.44, "floor": 0.0}
    words = predicted_words({"typical": miss, "tail": miss, "units": {"mm": 0.28, "deg": 0.32}})
    assert "1 013 σ without and 18.4 σ with it (median; 0 σ" in words


def test_first_screen_tells_misses_in_mm_and_the_checks(report):
    page, text, _ = report
    assert re.search(r"Misses[\d. ]+→ [\d.]+ mm", re.sub(r"\s+", " ", page.text))
    assert "Would this model have made these data?" in page.text and "checks.csv" in text
