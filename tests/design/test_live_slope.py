"""The live view of a page, in a browser: every control does its work, and the numbers are those of the tables."""

from __future__ import annotations

import json

import numpy as np
import pytest
from PIL import Image

import rock2d
from rock2d.design import live_slope
from rock2d.design.report import REPORTED_TABLES, ReportContent, report_page
from rock2d.design.report_tables import quantity_text
from rock2d.files.scenario import load_scenario
from rock2d.graphics.rendering import Made
from rock2d.runs.indicators.envelopes import QUANTITIES
from rock2d.runs.indicators.percentiles import percentile_table
from rock2d.wording import with_interval
from tests.browsing import (
    assert_not_printed_and_all_named,
    assert_nothing_else_was_run_or_loaded,
    assert_only_its_own_script_may_run,
    opened,
    picture,
    until,
)
from tests.diagnosis.test_report import Page
from tests.scenarios_of_tests import scenario_file

NASTY = "</script><b>x"
BLOCKS = f"""blocks:
  ball: {{shape: circle, diameter_m: 0.6, mass_kg: 305, inertia: solid_sphere}}
  "{NASTY}": {{shape: square, side_m: 0.5, mass_kg: 337, inertia: uniform}}"""
RELEASES = 80  # of each block: enough for the 95th percentile, not for the 99th


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    path = scenario_file(tmp_path_factory.mktemp("live"), "live", releases=RELEASES, blocks=BLOCKS)
    return rock2d.run(load_scenario(path))


@pytest.fixture(scope="module")
def report(result, tmp_path_factory):
    """The page with one small picture instead of its figures, which take long to draw."""
    folder = tmp_path_factory.mktemp("live_page")
    Image.new("RGB", (40, 20)).save(folder / "trajectories.png")
    content = ReportContent(
        result.scenario, result, {name: result.to_pandas(name) for name in REPORTED_TABLES}
    )
    made = Made("2025-03-31", "0", "rock2d run live.yaml --report", "3")
    (folder / "report.html").write_text(
        report_page(content, {"trajectories": folder / "trajectories.png"}, made), encoding="utf-8"
    )
    return folder / "report.html"


def test_without_a_script_the_view_is_hidden_and_only_its_own_script_may_run(report):
    text = report.read_text(encoding="utf-8")
    page = Page(text)
    assert [own["id"] for own in page.of("section") if "hidden" in own] == ["live"]
    assert_only_its_own_script_may_run(text)
    assert len(text) < 400_000


def test_what_does_not_fit_is_left_out_and_said(result, monkeypatch):
    whole = json.loads(live_slope.live_slope(result, len(result.tracks)).data)
    paths, impacts = (json.dumps(whole[name]) for name in ("paths", "impacts"))
    assert len(whole["paths"]["release"]) == len(whole["impacts"]["release"]) == 2 * RELEASES
    monkeypatch.setattr(live_slope, "MOST_IMPACTS", 100)
    less = live_slope.live_slope(result, len(result.tracks))
    assert 0.2 * len(impacts) > len(json.dumps(json.loads(less.data)["impacts"]))
    monkeypatch.setattr(live_slope, "MOST_BYTES", len(less.data) - len(paths) // 2)
    least = live_slope.live_slope(result, 3 * len(result.tracks))
    shown = json.loads(least.data)["paths"]
    assert 0.3 * len(paths) < len(json.dumps(shown)) < 0.7 * len(paths)
    assert sum(shown["worst"]) == 2 and set(shown["release"]) > set(range(10))
    assert f"{len(shown['release'])} of {2 * RELEASES} paths, the first ones and the worst" in least.notes[1]
    assert f"the first {2 * RELEASES} of {6 * RELEASES} releases" in least.notes[0]
    assert least.notes[2].startswith("Impacts are listed for ")


def test_the_worst_have_the_largest_energies_of_their_block(result):
    energies = {}
    for i, track in enumerate(result.tracks):
        block = result.blocks[track.block]
        vx, vy, omega = track.knots[:, 4:7].T
        energy = 0.5 * block.mass_kg * (vx**2 + vy**2) + 0.5 * block.inertia_kg_m2 * omega**2
        energies.setdefault(track.block, []).append((energy.max(), i))
    assert sorted(live_slope.worst_releases(result)) == sorted(max(own)[1] for own in energies.values())


@pytest.fixture(scope="module")
def watched(browser, report):
    """The page, and what its browser complains of or asks for."""
    return opened(browser, report)


@pytest.fixture
def page(watched):
    """The page as it is when opened at x = 20 m."""
    go(watched[0], 20.0)
    return watched[0]


def go(page, x_m: float) -> None:
    """Move the collector by the address, and leave no choice behind; the address differs each time."""
    page.evaluate("x => { location.hash = `#x=${x}&visit=${performance.now()}` }", x_m)
    until(page, lambda: abs(place(page) - x_m) < 0.06 and page.locator("#live-one").is_hidden())


def place(page) -> float:
    return float(page.inner_text("#live-place")[4:].split(" ")[0])


def shown(page, x_m: float) -> dict[str, list[str]]:
    """Words of each block at a station: its caption and its cells."""
    go(page, x_m)
    found = page.eval_on_selector_all(
        "#live-tables table",
        "all => all.map(t => [t.caption.textContent, ...[...t.querySelectorAll('td')].map(c => c.textContent)])",
    )
    return {words[0].split(":")[0]: words for words in found}


def test_at_measure_lines_the_numbers_are_those_of_the_tables(page, result):
    crossings, passing = map(result.to_pandas, ("crossings", "passing"))
    percentiles = percentile_table(crossings, percentiles=(50.0, 95.0, 99.0))
    x_of = crossings.groupby("line")["x_m"].median()
    assert len(x_of) > 1
    for row in passing.itertuples():
        words = shown(page, x_of[row.line])[row.block]
        frequency = with_interval(row.frequency, row.low95, row.high95, 100.0)
        assert words[0] == f"{row.block}: {row.passed} past, {frequency} % of the released"
        own = percentiles[(percentiles["line"] == row.line) & (percentiles["block"] == row.block)]
        for q, quantity in enumerate(("passing_height_m", "speed_m_s", "kinetic_J")):
            of = own[own["quantity"] == quantity]
            expected = [quantity_text(quantity, r.value, r.low95, r.high95) for r in of.itertuples()]
            assert words[2 + 4 * q : 5 + 4 * q] == expected


def test_elsewhere_the_numbers_are_those_of_the_envelopes(page, result):
    envelopes = result.to_pandas("envelopes")
    for x_m in envelopes["x_m"].unique()[3::9]:
        for block, words in shown(page, x_m).items():
            own = envelopes[(envelopes["block"] == block) & np.isclose(envelopes["x_m"], x_m)]
            if len(own):
                assert f": {own['passed'].iloc[0]} past," in words[0]
            for q, quantity in enumerate(QUANTITIES):
                expected = ["-"] * 3
                for r in own[own["quantity"] == quantity].itertuples():
                    expected[(50.0, 95.0, 99.0).index(r.percentile)] = quantity_text(
                        quantity, r.value, r.low95, r.high95
                    )
                assert words[2 + 4 * q : 5 + 4 * q] == expected and expected[2] == "-"


def test_pointer_and_keyboard_move_the_collector(page):
    stage = page.locator("#live-stage")
    stage.hover(position={"x": 700, "y": 60})
    until(page, lambda: place(page) != 20.0)
    slider = page.locator("#live-station")
    before, line = page.inner_text("#live-place"), picture(page, "#live-stage canvas:last-of-type")
    slider.focus()
    page.keyboard.press("ArrowRight")
    until(page, lambda: page.inner_text("#live-place") != before)
    assert slider.get_attribute("aria-valuetext") == page.inner_text("#live-place")
    assert picture(page, "#live-stage canvas:last-of-type") != line


def test_boxes_choose_blocks_stops_and_the_worst(page):
    assert f"{2 * RELEASES} of {2 * RELEASES} paths" in page.inner_text("#live-said")
    all_paths = picture(page, "#live-stage canvas")
    page.get_by_label("ball").uncheck()
    assert list(shown_now(page)) == [NASTY] and f"{RELEASES} of {2 * RELEASES} paths" in page.inner_text(
        "#live-said"
    )
    page.get_by_label("ball").check()
    page.get_by_label("only the worst").check()
    assert f"2 of {2 * RELEASES} paths" in page.inner_text("#live-said")
    assert picture(page, "#live-stage canvas") != all_paths
    page.get_by_label("only the worst").uncheck()
    boxes = page.locator("input[name=stop]")
    for i in range(boxes.count()):
        boxes.nth(i).uncheck()
    assert page.inner_text("#live-said").startswith("0 of")


def shown_now(page) -> list[str]:
    return [text.split(":")[0] for text in page.locator("#live-tables caption").all_text_contents()]


def test_the_curve_shows_the_chosen_quantity(page):
    seen = set()
    for i in range(4):
        page.locator("#live-quantity").select_option(str(i))
        seen.add(picture(page, "#live-curve"))
    assert len(seen) == 4 and "95 %" in page.inner_text("#live-key")


def test_a_release_is_chosen_with_its_impacts_and_plays(page, result):
    impacts = result.to_pandas("impacts")
    own = impacts[impacts["release"] == 3]
    page.get_by_label("Release").fill("3")
    page.keyboard.press("Enter")
    assert page.inner_text("#live-said").startswith("release 3, ball")
    rows = page.locator("#live-impacts tbody tr")
    assert rows.count() == len(own) > 1
    for i, r in enumerate(own.itertuples()):
        zone, *numbers = rows.nth(i).locator("td").all_text_contents()
        expected = [r.t_s, r.x_m, np.hypot(r.vx_m_s, r.vy_m_s), np.hypot(r.vx_after_m_s, r.vy_after_m_s),
                    r.penetration_m, 1e-3 * r.force_N]  # fmt: skip
        assert zone == r.zone.replace("_", " ")
        assert np.array(numbers, float) == pytest.approx(np.array(expected), rel=6e-3)
    clock = page.get_by_label("Time")
    time = lambda: float(clock.input_value())  # noqa: E731
    page.get_by_role("button", name="step on").click()
    assert time() == pytest.approx(0.04)
    page.get_by_role("button", name="step back").click()
    assert time() == 0.0
    start = picture(page, "#live-stage canvas:last-of-type")
    page.locator("#live-speed").select_option("4")
    page.get_by_role("button", name="play").click()
    until(page, lambda: time() > 0.3)
    page.get_by_role("button", name="pause").click()
    assert time() > 0.3 and picture(page, "#live-stage canvas:last-of-type") != start
    clock.focus()
    page.keyboard.press("End")
    assert time() == pytest.approx(float(clock.get_attribute("max")))
    page.get_by_role("button", name="show all paths").click()
    assert page.locator("#live-one").is_hidden() and "paths shown" in page.inner_text("#live-said")
    page.get_by_label("Release").fill("99999")
    page.keyboard.press("Enter")
    assert "no path of release 99999" in page.inner_text("#live-said")


def test_a_click_chooses_the_path_under_it(page):
    stage = page.locator("#live-stage")
    width, height = stage.bounding_box()["width"], stage.bounding_box()["height"]
    for share in np.linspace(0.1, 0.9, 30):
        stage.click(position={"x": 0.3 * width, "y": share * height})
        if page.input_value("#live-release"):
            break
    assert page.inner_text("#live-said").startswith(f"release {page.input_value('#live-release')}, ")


def test_the_address_holds_the_view(page, browser, report):
    page.get_by_label("ball").uncheck()
    page.locator("#live-quantity").select_option("2")
    page.get_by_label("Release").fill(str(RELEASES + 2))
    page.keyboard.press("Enter")
    until(page, lambda: "release" in page.url)
    other, _ = opened(browser, report, page.url[page.url.index("#") :])
    assert other.inner_text("#live-place") == page.inner_text("#live-place")
    assert shown_now(other) == [NASTY] and other.input_value("#live-quantity") == "2"
    assert other.input_value("#live-release") == str(RELEASES + 2)
    other.close()


def test_a_phone_shows_it_without_scrolling_sideways(page):
    page.set_viewport_size({"width": 390, "height": 844})
    page.get_by_label("Release").fill("3")
    page.keyboard.press("Enter")
    until(page, lambda: page.locator("#live-stage canvas").first.get_attribute("width") != "1080")
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    page.set_viewport_size({"width": 1280, "height": 1000})


def test_it_is_not_printed_and_every_control_has_a_name(page):
    assert_not_printed_and_all_named(page)


def test_names_stay_text_and_nothing_is_loaded(
    watched, report
):  # the last test: all others have used the page
    page, seen = watched
    assert page.locator("#live b").count() == 0 and page.get_by_label(NASTY).count() == 1
    assert_nothing_else_was_run_or_loaded(page, seen, report)
