"""The report of a site: whole, readable, with the numbers of the tables, and safe."""

import sys

import pytest
from click.testing import CliRunner

from rock2d.cli import cli
from rock2d.commands.run import RunRequest, run_scenarios
from rock2d.design.report_tables import quantity_text
from rock2d.errors import InputError
from rock2d.runs.campaigns import campaign
from rock2d.runs.campaigns.campaign import CampaignOptions
from rock2d.wording import three_digits, with_interval
from tests.diagnosis.test_report import Page
from tests.scenarios_of_tests import LAWS, UNKNOWN, scenario_file

COMMAND = "rock2d run 'a <b>.yaml' --report"
PROJECT = """project: {title: "Road </style><script>", number: "a\\"; } b {", client: "<i>Town</i>", author: "A & B",
          checked_by: "<b>C</b>", date: "2025-03-31"}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("report")
    odd = "about: A <script>slope</script> & a ball\nassumed: ['k_l is <guessed>']\n" + PROJECT
    path = scenario_file(out, "small", more=odd + UNKNOWN)
    run_scenarios([path], RunRequest(out, page_command=COMMAND, progress=False, report=str))
    return out / "small_batch"


def test_the_page_holds_figures_with_words_and_one_first_heading(folder):
    page = Page((folder / "report.html").read_text())
    assert page.tags.count("h1") == 1
    assert page.tags.count("img") >= 6 and all(len(image["alt"]) > 30 for image in page.of("img"))
    assert page.tags.count("script") == 2  # the data and the script of the live view
    for name in ("trajectories", "embankment", "envelopes", "stops", "distributions"):
        assert (folder / f"{name}.png").stat().st_size > 5000


def test_the_page_says_what_was_assumed_and_how_it_was_made(folder):
    text = (folder / "report.html").read_text()
    assert "k_l is &lt;guessed&gt;" in text
    assert "A &lt;script&gt;slope" in text
    assert "rock2d run &#39;a &lt;b&gt;.yaml&#39; --report" in text
    assert "Not known: model.deterministic.default.k_ul_N_m" in text
    assert "3 (of every random draw)" in text


def test_the_page_and_the_tables_agree(folder):
    import pandas as pd

    text = (folder / "report.html").read_text()
    for r in pd.read_csv(folder / "passing.csv").itertuples():
        assert with_interval(r.frequency, r.low95, r.high95, 100.0) in text
    values = pd.read_csv(folder / "design_values.csv")
    arrival = values[values["line"] == "arrival"]
    assert len(arrival) == 6
    for r in arrival.itertuples():
        assert quantity_text(r.quantity, r.design, r.low95, r.high95) in text
        assert r.not_verified  # no value rests on numbers that two sources state
    assert text.count("<td>not verified</td>") == len(arrival) + 9
    assert "Rocscience, RocFall help" in text and "<td>set in the scenario</td>" not in text


def test_the_head_has_the_project_and_lines_to_sign_escaped(folder):
    text = (folder / "report.html").read_text()
    page = Page(text)
    assert "i" not in page.tags and page.tags.count("style") == 1
    head = text[: text.index("<section>")]
    for shown in (
        "Road &lt;/style&gt;&lt;script&gt;",
        "&lt;i&gt;Town&lt;/i&gt;",
        "A &amp; B",
        "&lt;b&gt;C&lt;/b&gt;",
        "2025-03-31",
    ):
        assert shown in head
    assert head.count("date, signature") == 2
    style = text[text.index("<style>") : text.index("</style>")]
    assert "Road" in style and "script>" not in style and 'a"' not in style


def test_the_page_has_the_angle_of_reach(folder):
    import pandas as pd

    reach = pd.read_csv(folder / "reach.csv")
    assert reach["angle"].tolist() == ["reach", "energy_line"]
    assert f"{three_digits(reach['least_deg'][0])}°" in (folder / "report.html").read_text()


def test_a_tornado_is_drawn_only_where_the_errors_are_smaller_than_the_bars(folder):
    import pandas as pd

    from rock2d.design.assessment import Assessment

    columns = ("block", "line", "parameter", "total", "total_error95")
    rows = [("a", "crest", "k", 1.2, 0.3), ("a", "crest", "f", 0.1, 0.2), ("b", "crest", "k", 0.5, 0.1),
            ("b", "crest", "f", 0.4, 0.6)]  # fmt: skip
    found = Assessment(pd.DataFrame(), pd.DataFrame(rows, columns=list(columns)), pd.DataFrame())
    assert found.told_apart["block"].unique().tolist() == ["a"]
    axis = found.plot().axes[0]
    assert axis.get_xlim()[1] > 1.5  # no index is cut off
    assert sorted(bar.get_width() for bar in axis.patches if bar.get_width() == bar.get_width()) == [1.2]
    written = Assessment(pd.DataFrame(), pd.read_csv(folder / "sensitivity.csv"), pd.DataFrame())
    known = len(written.told_apart) > 0
    assert (folder / "tornado.png").is_file() is known
    assert known or "Increase <code>uncertainty.sites</code>" in (folder / "report.html").read_text()


def test_without_weasyprint_the_command_stops_before_it_runs_anything(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "weasyprint", None)
    path = scenario_file(tmp_path, "small")
    for command in (["run", path], ["design", path, "--range", "1", "3"]):
        done = CliRunner().invoke(cli, [*map(str, command), "--pdf", "--out", str(tmp_path / "out")])
        assert isinstance(done.exception, InputError) and done.exception.code == "missing_package"
        assert str(done.exception) == "a PDF needs WeasyPrint: pip install 'rock2d[pdf]'"
    assert not (tmp_path / "out").exists()


def test_the_page_is_printed_with_its_footer(folder, tmp_path):
    pytest.importorskip("weasyprint")
    from rock2d.graphics.pages import write_pdf

    write_pdf((folder / "report.html").read_text(), tmp_path / "report.pdf")
    assert (tmp_path / "report.pdf").read_bytes().startswith(b"%PDF-")


@pytest.mark.parametrize(
    "value, text",
    [(0.0, "0"), (1234.4, "1230"), (0.12345, "0.123"), (99.96, "100"), (12.0, "12.0"), (2.4e7, "2.40e+07"),
     (-3.456, "-3.46"), (float("nan"), "-")],
)  # fmt: skip
def test_numbers_have_three_significant_digits(value, text):
    assert three_digits(value) == text


def test_energies_are_told_in_kilojoules_where_these_are_usual():
    assert quantity_text("kinetic_J", 1.25e6, 1.0e6, 1.5e6) == "1250 [1000, 1500] kJ"
    assert quantity_text("kinetic_J", 0.25, 0.2, 0.3) == "0.250 [0.200, 0.300] J"
    assert quantity_text("speed_m_s", 20.0, 18.0, 22.0) == "20.0 [18.0, 22.0] m/s"


def test_rough_ground_that_a_slope_reduction_replaces_is_not_listed(tmp_path):
    model = LAWS.replace("restitution: 0.9}", "restitution: 0.9}, slope: {slope_reduction_deg: 9}")
    rough = "roughness: {slope: {sd_deg: 3, length_m: 0.6}, run_out: {sd_deg: 2, length_m: 0.6}}\n"
    path = scenario_file(tmp_path, "small", engine="point_mass", releases=5, model=model, more=rough)
    run_scenarios([path], RunRequest(tmp_path, page_command=COMMAND, draw=False, progress=False, report=str))
    text = (tmp_path / "small_point_mass" / "report.html").read_text()
    assert "Rough ground in run_out" in text and "Rough ground in slope" not in text


def test_a_campaign_has_the_same_page(tmp_path, monkeypatch):
    monkeypatch.setattr(campaign, "MOST_RELEASES_IN_MEMORY", 1000)
    path = scenario_file(tmp_path, "small", engine="point_mass")
    options = CampaignOptions(releases=1050)
    run_scenarios([path], RunRequest(tmp_path, options, page_command=COMMAND, progress=False, report=str))
    text = (tmp_path / "small_point_mass" / "report.html").read_text()
    assert "<td>1050</td>" in text
    assert "This view shows the first 1000 of 1050 releases" in text
    assert "the first 200 of 1000 releases" not in text  # words of a figure are no words of the page
    assert (tmp_path / "small_point_mass" / "envelopes.csv").is_file()
