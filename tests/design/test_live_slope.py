"""The live view of a page, in a browser: every control does its work, and the numbers are those of the tables."""

import base64
import json
import re
import zlib

import numpy as np
import pytest
from PIL import Image

import rock2d
from rock2d.design import live_slope
from rock2d.design.live_slope import ShownRun
from rock2d.design.report import report_page
from rock2d.design.report_sections import REPORTED_TABLES, ReportContent
from rock2d.design.report_tables import quantity_text
from rock2d.files.scenario_reading import load_scenario
from rock2d.files.scenario_variants import variant
from rock2d.graphics.rendering import Made
from rock2d.runs.indicators.envelopes import QUANTITIES
from rock2d.statistics import percentile_estimate
from rock2d.wording import with_interval
from tests.browsing import (
    ask_for_release,
    assert_not_printed_and_all_named,
    assert_nothing_else_was_run_or_loaded,
    assert_only_its_own_script_may_run,
    on_a_phone,
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
OTHERS = 25  # releases of each block at the higher embankment


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    path = scenario_file(tmp_path_factory.mktemp("live"), "live", releases=RELEASES, blocks=BLOCKS)
    return rock2d.run(load_scenario(path))


@pytest.fixture(scope="module")
def higher(result):
    """Some of the releases at a higher embankment, which the page can show beside the run."""
    return rock2d.run(variant(result.scenario, {"embankment.height_m": 3.0}), releases=OTHERS)


@pytest.fixture(scope="module")
def report(result, higher, tmp_path_factory):
    """The page with one small picture instead of its figures, which take long to draw."""
    folder = tmp_path_factory.mktemp("live_page")
    Image.new("RGB", (40, 20)).save(folder / "trajectories.png")
    views = [ShownRun("as in the file", result), ShownRun(NASTY, higher, "3 m high")]
    content = ReportContent(result, {name: result.to_pandas(name) for name in REPORTED_TABLES}, views=views)
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


def test_what_does_not_fit_is_left_out_and_said(result, higher, monkeypatch):
    def live(released=2 * RELEASES):
        found = live_slope.live_slope([ShownRun("run", result), ShownRun("higher", higher)], released)
        return found, json.loads(found["data"])["runs"]

    _, (whole, other) = live()
    paths, impacts = (json.dumps(whole[name]) for name in ("paths", "impacts"))
    assert len(whole["paths"]["release"]) == len(whole["impacts"]["release"]) == 2 * RELEASES
    assert len(other["paths"]["release"]) == 2 * OTHERS
    monkeypatch.setattr(live_slope, "MOST_IMPACTS", 200)
    less, runs = live()
    assert 0.2 * len(impacts) > len(json.dumps(runs[0]["impacts"]))
    assert runs[0]["notes"][1].startswith("Impacts are listed for ")
    monkeypatch.setattr(live_slope, "MOST_BYTES", len(less["data"]) - len(paths) // 2)
    least, (run, other) = live(6 * RELEASES)
    assert 0.3 * len(paths) < len(json.dumps(run["paths"])) < 0.7 * len(paths)
    assert sum(run["paths"]["worst"]) == 2 and set(run["paths"]["release"]) > set(range(10))
    assert f"{len(run['paths']['release'])} of {2 * RELEASES} paths, the first ones and the worst" in run["notes"][0]
    assert f"the first {2 * RELEASES} of {6 * RELEASES} releases" in least["notes"][0]
    assert len(least["data"]) < live_slope.MOST_BYTES + 2000


def test_the_worst_have_the_largest_energies_of_their_block(result):
    energies = {}
    for i, track in enumerate(result.tracks):
        block = result.blocks[track.block]
        vx, vy, omega = track.knots[:, 4:7].T
        energy = 0.5 * block.mass_kg * (vx**2 + vy**2) + 0.5 * block.inertia_kg_m2 * omega**2
        energies.setdefault(track.block, []).append((energy.max(), i))
    largest_J = live_slope.largest_energies(result)
    assert sorted(live_slope.worst_releases(result, largest_J)) == sorted(max(own)[1] for own in energies.values())
    assert [largest_J[i] for _, i in map(max, energies.values())] == pytest.approx(
        [max(own)[0] for own in energies.values()]
    )


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
    x_of = crossings.groupby("line")["x_m"].median()
    assert len(x_of) > 1
    for row in passing.itertuples():
        words = shown(page, x_of[row.line])[row.block]
        frequency = with_interval(row.frequency, row.low95, row.high95, 100.0)
        assert words[0] == f"{row.block}: {row.passed} past, {frequency} % of the released"
        own = crossings[(crossings["line"] == row.line) & (crossings["block"] == row.block)]
        for q, quantity in enumerate(("passing_height_m", "speed_m_s", "kinetic_J")):
            ranked = np.sort(own[quantity])
            found = [percentile_estimate(ranked, len(ranked), p) for p in (50.0, 95.0, 99.0)]
            expected = [quantity_text(quantity, *estimate) for estimate in found]
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
    assert list(shown_now(page)) == [NASTY] and f"{RELEASES} of {2 * RELEASES} paths" in page.inner_text("#live-said")
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


def test_the_histogram_counts_the_blocks_that_come_past(page, result):
    page.locator("#live-quantity").select_option("0")
    assert page.locator("#live-histogram").is_hidden()
    page.locator("#live-quantity").select_option("3")
    before = picture(page, "#live-histogram")
    go(page, 15.0)
    page.locator("#live-quantity").select_option("3")
    assert page.locator("#live-histogram").is_visible() and picture(page, "#live-histogram") != before
    own = json.loads(page.locator("#live-data").text_content())
    counts = np.frombuffer(zlib.decompress(base64.b64decode(own["runs"][0]["counts"])), "<u2")
    counts = counts.reshape(len(own["runs"][0]["stations"]), 3, 2, own["bins"])
    crossings = result.to_pandas("crossings")
    for s, (_, _, line) in enumerate(own["runs"][0]["stations"]):
        for b, block in enumerate(("ball", NASTY)):
            passed = own["runs"][0]["texts"][b][s][0]
            assert (counts[s, :, b].sum(axis=-1) == passed).all()
            if line:
                at = crossings[(crossings["line"] == line.replace(" ", "_")) & (crossings["block"] == block)]
                ends = np.linspace(0.0, own["runs"][0]["ends"][s][1], own["bins"] + 1)
                inside = np.histogram(at["speed_m_s"], ends)[0]
                assert abs(counts[s, 1, b] - inside).sum() <= 2  # the upper end has four digits


def test_another_run_is_shown_and_stands_beside(page, result, higher):
    at = float(result.to_pandas("crossings").query("line == 'arrival'")["x_m"].median())
    first = shown(page, at)["ball"]
    page.locator("#live-view").select_option("1")
    assert page.inner_text("#live-viewed") == f"{NASTY}: 3 m high"
    passing = higher.to_pandas("passing").query("line == 'arrival' and block == 'ball'").iloc[0]
    caption = page.locator("#live-tables caption").first.text_content()
    words = with_interval(passing["frequency"], passing["low95"], passing["high95"], 100.0)
    assert caption == f"ball: {passing['passed']} past, {words} % of the released"
    assert f"{2 * OTHERS} of {2 * OTHERS} paths shown" in page.inner_text("#live-said")
    page.locator("#live-beside").select_option("0")
    assert f"as in the file: {2 * RELEASES} of {2 * RELEASES}" in page.inner_text("#live-said")
    beside = page.locator("#live-tables table").first.locator("small").all_text_contents()
    assert beside[0].startswith("as in the file: ") and beside[1:] == [first[k] for k in (2, 3, 4, 6, 7, 8, 10, 11, 12)]
    one = picture(page, "#live-stage canvas")
    ask_for_release(page, OTHERS + 3)
    assert page.inner_text("#live-said").startswith(f"release {OTHERS + 3}, {NASTY}")
    assert picture(page, "#live-stage canvas") != one
    until(page, lambda: "view=1&beside=0" in page.url)
    page.locator("#live-view").select_option("0")
    assert (result.tracks[RELEASES + 3].knots[0] == higher.tracks[OTHERS + 3].knots[0]).all()
    assert page.input_value("#live-release") == f"{RELEASES + 3}" and page.input_value("#live-beside") == "-1"


def test_it_stays_readable_where_the_screen_is_dark(page):
    page.emulate_media(color_scheme="dark")
    colours = page.evaluate(
        """() => { const of = (name) => getComputedStyle(document.querySelector(name));
        return [of('body').backgroundColor, of('body').color, of('.note').color, of('#live-stage').backgroundColor] }"""
    )
    paper, ink, pale, plate = (np.array(colour[4:-1].split(","), float) for colour in colours)
    assert contrast(ink, paper) > 7 and contrast(pale, paper) > 4.5  # WCAG 2.2, levels AAA and AA
    assert paper.max() < 40 and plate.min() == 255
    page.emulate_media(color_scheme="light")


def contrast(one, other) -> float:
    """Contrast ratio of two sRGB colours, WCAG 2.2."""

    def luminance(colour) -> float:
        share = colour / 255
        return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4) @ (0.2126, 0.7152, 0.0722)

    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_a_release_is_chosen_with_its_impacts_and_plays(page, result):
    impacts = result.to_pandas("impacts")
    own = impacts[impacts["release"] == 3]
    ask_for_release(page, 3)
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
    ask_for_release(page, 99999)
    assert "no path of release 99999" in page.inner_text("#live-said")


def test_the_worst_release_says_its_energy_and_where_it_started(page, result):
    largest_J = live_slope.largest_energies(result)
    page.get_by_role("button", name="the one with the largest energy").click()
    track = result.tracks[int(largest_J.argmax())]
    said = page.inner_text("#live-said")
    assert said.startswith(f"release {track.release}, ") and f"largest energy {1e-3 * largest_J.max():.3g} kJ" in said
    start = [float(number) for number in re.findall(r"[xy] = ([-\d.]+) m", said)]
    assert start == pytest.approx(track.knots[0, 1:3], rel=6e-3)


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
    ask_for_release(page, RELEASES + 2)
    until(page, lambda: "release" in page.url)
    other, _ = opened(browser, report, page.url[page.url.index("#") :])
    assert other.inner_text("#live-place") == page.inner_text("#live-place")
    assert shown_now(other) == [NASTY] and other.input_value("#live-quantity") == "2"
    assert other.input_value("#live-release") == str(RELEASES + 2)
    other.close()


def test_a_phone_shows_it_without_scrolling_sideways(page):
    with on_a_phone(page):
        ask_for_release(page, 3)
        until(page, lambda: page.locator("#live-stage canvas").first.get_attribute("width") != "1080")


def test_it_is_not_printed_and_every_control_has_a_name(page):
    assert_not_printed_and_all_named(page)


def test_names_stay_text_and_nothing_is_loaded(watched, report):  # the last test: all others have used the page
    page, seen = watched
    assert page.locator("#live b").count() == 0 and page.get_by_role("checkbox", name=NASTY).count() == 1
    assert_nothing_else_was_run_or_loaded(page, seen, report)
