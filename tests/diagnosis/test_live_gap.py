"""The live view of a diagnosis, in a browser: every control does its work, and the numbers are those of the tables."""

import base64
import io
import json
import re
from dataclasses import replace
from itertools import chain, combinations

import numpy as np
import pandas as pd
import pytest

from rock2d.diagnosis.diagnosis_content import diagnosis_json
from rock2d.diagnosis.gap import CHANNELS
from rock2d.diagnosis.predicted_gap import held_out_poses, off
from rock2d.diagnosis.replay import Segments
from rock2d.diagnosis.report import live_gap
from rock2d.diagnosis.report.report_data import impact_misses, touch_places
from rock2d.diagnosis.report.sections import p_text
from rock2d.diagnosis.report.text import share_closed
from rock2d.records.columns import THETA
from rock2d.wording import spoken
from tests.browsing import (
    ask_for_release,
    assert_not_printed_and_all_named,
    assert_nothing_else_was_run_or_loaded,
    on_a_phone,
    opened,
    picture,
    until,
)
from tests.diagnosis.test_report import EFFECTS, NAME, Page, quick, write
from tests.kinematics.synthetic_films import film, series_order, with_causes, world

RELEASES = 8  # of each block: enough that both causes are named, and that the damping is learnt
# the last one is not tried, so it is learnt without a name
TRUE = {"camera_tilt": [0.04, 0.0, 0.0], "inertia_error": [1.4], "flight_damping": [1.5]}
SECTION, CLOSE = "#live-stage canvas", "#live-near canvas"


@pytest.fixture(scope="module")
def diagnosed():
    true = with_causes(world(series_order(RELEASES)), TRUE)
    experiment = replace(film(true, RELEASES, seed=5, fps=500.0, duration_s=0.3), name=NAME)
    result = quick(experiment, **EFFECTS)
    assert result.found.named == {"camera_tilt", "inertia_error"} and result.found.learnt.changes
    return result


@pytest.fixture(scope="module")
def report(diagnosed, tmp_path_factory):
    folder = tmp_path_factory.mktemp("live_gap")
    write(diagnosed, folder)
    return folder / "report.html"


@pytest.fixture(scope="module")
def watched(browser, report):
    """The page, and what its browser complains of or asks for."""
    return opened(browser, report)


@pytest.fixture
def page(watched):
    """The page as it is when opened; the address differs each time."""
    page, _ = watched
    page.evaluate("() => { location.hash = `#visit=${performance.now()}` }")
    until(page, lambda: page.input_value("#live-item") == "" and page.locator(".off").count() == 0)
    return page


def tick(page, *names: str) -> None:
    """Tick the causes of these names, and no others."""
    boxes = page.locator("input[name=cause]")
    for i in reversed(range(boxes.count())):
        boxes.nth(i).uncheck()
    for name in names:
        cause(page, spoken(name)).check()


def cause(page, name: str):
    """The box of a cause."""
    return page.get_by_role("checkbox", name=name)


def model_words(page) -> str:
    """All that is shown of the ticked causes; with plain spaces before percent signs."""
    return " ".join(page.locator(".live-model:visible").all_inner_texts()).replace("\N{NO-BREAK SPACE}%", " %")


def cells(page, row: str) -> list[list[str]]:
    """Words of the cells of rows; with plain spaces before percent signs."""
    read = "all => all.map(r => [...r.querySelectorAll('td')].map(c => c.textContent.replaceAll('\\u00a0%', ' %')))"
    return page.eval_on_selector_all(row, read)


def of_models(result):
    """The models that can be ticked: causes -> fit with its held-out residuals."""
    everything = (*sorted(result.found.named), "learnt")
    return {tuple(sorted(names)): own for names, own in result.found.sets.items()} | {everything: result.found.learnt}


def test_without_a_script_the_page_is_as_before_and_small(diagnosed, report):
    text = report.read_text(encoding="utf-8")
    assert [own["id"] for own in Page(text).of("section") if "hidden" in own] == ["live"]
    data = text.split('id="live-data">')[1].split("</script>")[0]
    assert "<" not in data and len(data) < 150_000
    assert 'id="live"' not in text.split("</section>", 1)[1]


@pytest.mark.parametrize("names", list(chain(*(combinations(sorted(EFFECTS), k) for k in range(3)))))
def test_ticked_causes_show_their_gap_of_the_budget(page, diagnosed, names):
    tick(page, *names)
    gap, share = diagnosed.budget.sets[frozenset(names)]
    words = model_words(page)
    assert f"{gap:.2f} σ" in words
    if names:
        assert f"closed {share_closed(share.closes, share.ci95)}" in words
    heads = page.locator("#live-channels th").all_inner_texts()
    assert len(heads) == (4 if names else 3) and all(spoken(name) in heads[-1] for name in names)


def test_each_cause_has_its_share_of_the_budget_and_the_shares_in_the_first_and_last_place(page, diagnosed):
    sets, rows = diagnosed.budget.sets, page.locator("#live table.chart tr").all_inner_texts()
    both = frozenset(EFFECTS)
    for name, own in diagnosed.budget.causes.items():
        row = next(row for row in rows if row.strip().startswith(spoken(name))).replace("\N{NO-BREAK SPACE}%", " %")
        alone, last = sets[frozenset({name})][1].closes, sets[both][1].closes - sets[both - {name}][1].closes
        assert share_closed(own.closes, own.ci95) in row
        assert f"alone {100 * alone:.0f} %, after all others {100 * last:.0f} %" in row
        assert min(alone, last) == pytest.approx(own.range[0]) and max(alone, last) == pytest.approx(own.range[1])


def test_what_was_learnt_needs_all_causes(page, diagnosed):
    tick(page)
    cause(page, "learnt").check()
    assert page.locator("input[name=cause]:checked").count() == 3
    content = diagnosis_json(diagnosed)
    assert f"{content['gap']['augmented']:.2f} σ" in model_words(page)
    cause(page, "camera tilt").uncheck()
    assert not cause(page, "learnt").is_checked()
    assert page.inner_text("#live-model") == "Model: with inertia error"


def test_misses_are_those_of_the_tiles_and_the_passing_frequencies_those_of_the_charts(page, diagnosed, report):
    physical = diagnosis_json(diagnosed)["physical"]
    for names, side in (((), "base"), (("learnt",), "augmented")):
        tick(page, *names)
        words = model_words(page)
        for key, unit in (("mm", " mm"), ("deg", "°"), ("m_s", " m/s")):
            assert f"{physical[key][side]:.2g}{unit}" in words
    link = next(own for own in Page(report.read_text()).of("a") if own["download"] == "passing_frequency.csv")
    table = pd.read_csv(io.BytesIO(base64.b64decode(link["href"].split(",")[1])))
    tick(page, *EFFECTS)
    page.locator(".live-model:visible summary").click()
    rows = {row[0]: row[1:] for row in cells(page, ".live-model:not([hidden]) details tr") if row}
    found = " and ".join(spoken(effect.name) for effect in diagnosed.found.final.fit.model.effects)
    models = ["measured", "base law", f"with {found}"]
    for (place, block), own in table.groupby(["place", "block"]):
        values = own.set_index("model")["value (%)"]
        assert rows[f"{place}: {block}"] == [f"{values[model]:.0f} %" for model in models]
    tick(page, "inertia_error")
    assert "not simulated" in model_words(page)


def test_causes_that_were_not_computed_together_are_said(browser, report, tmp_path):
    text = report.read_text(encoding="utf-8")
    assert '"models":[[],[0],[1],' in text
    (tmp_path / "less.html").write_text(text.replace('"models":[[],[0],', '"models":[[],[9],'), encoding="utf-8")
    page, _ = opened(browser, tmp_path / "less.html")
    cause(page, "learnt").uncheck()
    page.locator("input[name=cause]").nth(1).uncheck()
    assert "not computed together" in page.inner_text("#live-model") and not model_words(page)
    assert page.locator("#live-channels th").all_inner_texts()[2:] == ["base law"]
    page.close()


def test_residuals_by_channel_are_those_of_the_places(page, diagnosed):
    compared = 0
    for cell in diagnosed.cells:
        if cell.phase == "rest":
            continue
        page.locator("#live-block").select_option(spoken(cell.block))
        page.locator("#live-zone").select_option(spoken(cell.zone))
        rows = {row[0]: row[1:] for row in cells(page, "#live-channels tbody tr")}
        n, base, best = rows[f"{cell.phase}, {cell.channel}"]
        assert base.startswith(f"{cell.base:.1f} σ (") and best.startswith(f"{cell.augmented:.1f} σ (")
        own = diagnosed.data.impact_block if cell.phase == "impact" else diagnosed.data.flight_block
        assert 0 < int(n) <= (own == list(diagnosed.experiment.blocks).index(cell.block)).sum()
        compared += 1
    assert compared > 3


def test_median_misses_of_a_channel_are_those_of_the_residuals(page, diagnosed):
    tick(page, "camera_tilt")
    residuals = diagnosed.found.sets[frozenset({"camera_tilt"})].held_out.residuals.impacts
    rows = {row[0]: row[-1] for row in cells(page, "#live-channels tbody tr")}
    pose, rate = np.nanmedian(np.abs(residuals), axis=0).reshape(2, 3)
    for c, (name, unit, small, factor) in enumerate(
        (("tangential", "m/s", "mm", 1e3), ("normal", "m/s", "mm", 1e3), ("spin", "rad/s", "°", np.rad2deg(1.0)))
    ):
        expected = f"({rate[c]:.2g} {unit}, {factor * pose[c]:.2g} {small})".replace(" °", "°")
        assert rows[f"impact, {name}"].endswith(expected)
    assert len(rows) == 2 * (1 + len(CHANNELS["impact"]))
    page.locator("#live-phase").select_option("flights")
    assert [row[0].split(",")[0] for row in cells(page, "#live-channels tbody tr")] == ["flight"] * 4


def test_zones_have_their_typical_residuals_and_can_be_chosen(page, diagnosed):
    tick(page, "camera_tilt")
    data, zones = diagnosed.data, diagnosed.experiment.cross_section.zone_names
    models = (diagnosed.found.base.held_out, diagnosed.found.sets[frozenset({"camera_tilt"})].held_out)
    rows = {row[0]: row[1:] for row in cells(page, "#live-zones tbody tr")}
    for z in np.unique(data.impact_zone):
        own = data.impact_zone == z
        sizes = [np.exp(np.log(impact_misses(diagnosed, out).sigma[own]).mean()) for out in models]
        assert rows[spoken(zones[z])][:3] == [str(own.sum()), *(f"{size:.1f} σ" for size in sizes)]
    assert sum(int(row[0]) for row in rows.values()) == len(data.impacts)
    page.locator("#live-zones button", has_text="ditch").click()
    assert page.locator("#live-zone").input_value() == str(zones.index("ditch"))
    assert cells(page, "#live-channels tbody tr")[0][1:] == rows["ditch"][:3]
    assert page.evaluate("document.activeElement.textContent") == "ditch"
    page.keyboard.press("Enter")
    assert page.locator("#live-zone").input_value() == ""


def listed(page) -> list[str]:
    return page.locator("#live-item option").all_inner_texts()[1:]


def test_the_list_has_the_sizes_of_the_impact_table_and_filters_choose_of_it(page, diagnosed):
    sizes = impact_misses(diagnosed, diagnosed.found.base.held_out).sigma
    page.locator("#live-phase").select_option("impacts")
    tick(page)
    said = listed(page)
    assert [own.split(":")[0] for own in said] == [f"{size:.1f} σ" for size in sorted(sizes, reverse=True)]
    tick(page, "camera_tilt", "inertia_error")
    left = impact_misses(diagnosed, diagnosed.found.sets[frozenset(EFFECTS)].held_out).sigma
    whole = picture(page, SECTION)
    page.locator("#live-size").select_option("1.5 σ and more")
    assert 0 < len(listed(page)) == (left.astype("<f4") >= 1.5).sum() < (sizes >= 1.5).sum()
    assert page.inner_text("#live-said").startswith(f"{len(listed(page))} of ")
    assert picture(page, SECTION) != whole
    page.locator("#live-size").select_option("any size")
    page.locator("#live-zone").select_option("ditch")
    zones = diagnosed.experiment.cross_section.zone_names
    assert len(listed(page)) == (diagnosed.data.impact_zone == zones.index("ditch")).sum()
    page.locator("#live-block").select_option("cube")
    assert all("cube" in own and "ditch" in own for own in listed(page))


def test_an_impact_is_shown_measured_and_simulated(page, diagnosed):
    """Simulated velocities are the measured ones and the residual; their rows follow the ticked causes."""
    data, i = diagnosed.data, 2
    began = data.film.t_s[np.searchsorted(data.film.release, data.impacts.release[i])]
    at = data.film.t_s[data.flights.last[data.impacts.before[i]] - 1] - began
    release = data.film.release_names[data.impacts.release[i]]
    for names, own in of_models(diagnosed).items():
        tick(page, *names)
        name = next(t for t in listed(page) if f"release {release}," in t and f"t = {at:.3f} s" in t and "impact" in t)
        page.locator("#live-item").select_option(name)
        before, after, *simulated = cells(page, "#live-one tbody tr")
        assert before[0] == "before, measured" and float(before[2]) < 0.0 < float(after[2])
        assert len(simulated) == (2 if names else 1)
        left = own.held_out.residuals.impacts[i]
        numbers = [float(cell) for cell in simulated[-1][1:7]]
        measured = np.array([float(cell) for cell in after[1:4]])
        assert numbers[:3] == pytest.approx(measured + left[3:], abs=0.011)
        assert numbers[3:] == pytest.approx(left[:3] * [1e3, 1e3, np.rad2deg(1.0)], abs=0.011)
    assert page.input_value("#live-release") == str(release)
    after = data.flights.middle[data.impacts.after[i]] + data.impacts.begin_s[i] - began
    shown_s = float(re.match(r"t = ([\d.]+) s", frame_words(page)).group(1))
    assert after - 2 / 500.0 < shown_s < after + 1e-3  # where the flight after it begins


def test_a_click_on_the_section_chooses_what_lies_there(page, diagnosed):
    left, right, low, high = json.loads(page.inner_text("#live-data"))["limits"]
    scale = min((page.locator("#live-stage").bounding_box()["width"] - 56) / (right - left), 440 / (high - low))
    places, data = touch_places(diagnosed, diagnosed.data), diagnosed.data
    page.locator("#live-phase").select_option("impacts")
    for i in range(0, len(places), 4):
        x, y = places[i]
        stage = page.locator("#live-stage")
        middle = (stage.bounding_box()["width"] + 36) / 2  # the margins are 46 and 10 wide, 8 high
        stage.click(position={"x": middle + (x - (left + right) / 2) * scale, "y": 8 + (high - y) * scale})
        near = np.hypot(*(places - places[i]).T) * scale < 3.0
        releases = set(data.film.release_names[data.impacts.release[near]].tolist())
        assert page.inner_text("#live-one caption").startswith(tuple(f"release {r}," for r in releases))
        assert int(page.input_value("#live-release")) in releases
    stage.click(position={"x": 60, "y": 12})  # nothing is there
    assert page.input_value("#live-item") == "" and page.locator("#live-one").is_hidden()


def frame_words(page) -> str:
    return page.inner_text("#live-frame")


def test_a_release_plays_and_each_frame_says_the_gap_of_the_predictions(page, diagnosed):
    """Place and angle of the last frame of a segment, of all models."""
    data = diagnosed.data
    segments = Segments.of(data)
    s = int(np.flatnonzero(segments.number == 1)[0])
    rows, release = segments.frames[s], segments.release[s]
    t = data.film.t_s[rows[-1]] - data.film.t_s[np.searchsorted(data.film.release, release)]
    ask_for_release(page, data.film.release_names[release])
    page.locator("#live-time").evaluate("(c, t) => { c.value = t; c.dispatchEvent(new Event('input')) }", t + 1e-5)
    assert "segment 2 of" in frame_words(page)
    seen = set()
    for names, own in of_models(diagnosed).items():
        tick(page, *names)
        miss = off(held_out_poses(data, segments, own)[s, len(rows) - 1], data.film.pose[rows[-1]])
        mm, degrees = map(float, re.findall(r"([\d.]+) mm and ([\d.]+)°", frame_words(page))[-1])
        assert mm == pytest.approx(1e3 * np.hypot(*miss[:2]), abs=0.06)
        assert degrees == pytest.approx(abs(np.rad2deg(miss[THETA])), abs=0.06)
        seen.add(picture(page, CLOSE))
    assert len(seen) == len(of_models(diagnosed))
    before = picture(page, CLOSE)
    page.get_by_role("button", name="frame on").click()
    assert frame_words(page).startswith("t = ") and "segment 2" not in frame_words(page).split(":")[0]
    assert picture(page, CLOSE) != before
    page.get_by_role("button", name="frame back").click()
    assert "segment 2 of" in frame_words(page) and picture(page, CLOSE) == before
    page.get_by_role("button", name="segment back").click()  # to its beginning
    assert "segment 2 of" in frame_words(page)
    page.get_by_role("button", name="segment back").click()
    assert "segment 1 of" in frame_words(page)
    for _ in range(2):
        page.get_by_role("button", name="segment on").click()
    assert "segment 3 of" in frame_words(page)


def test_a_release_lists_its_impacts_and_flights_and_each_can_be_chosen(page, diagnosed):
    data = diagnosed.data
    ask_for_release(page, data.film.release_names[5])
    tick(page, "inertia_error")
    rows = cells(page, "#live-own tbody tr")
    flights, impacts = np.flatnonzero(data.flight_release == 5), np.flatnonzero(data.impact_release == 5)
    assert [row[1] for row in rows].count("flight") == len(flights)
    assert [float(row[0]) for row in rows] == sorted(float(row[0]) for row in rows)
    own = [row for row in rows if row[1] == "impact"]
    models = (diagnosed.found.base.held_out, diagnosed.found.sets[frozenset({"inertia_error"})].held_out)
    for i, row in zip(impacts, own, strict=True):
        for out, said in zip(models, row[3:], strict=True):
            size, mm, degrees = map(float, re.findall(r"[\d.]+", said))
            x, y, angle = out.residuals.impacts[i, :3]
            assert size == pytest.approx(impact_misses(diagnosed, out).sigma[i], abs=0.051)
            assert mm == pytest.approx(1e3 * np.hypot(x, y), abs=0.0051)
            assert degrees == pytest.approx(abs(np.rad2deg(angle)), abs=0.0051)
    page.locator("#live-own button").nth(1).focus()
    page.keyboard.press("Enter")
    assert page.locator("#live-own [aria-pressed=true]").inner_text() == rows[1][0]
    assert f"t = {rows[1][0]} s" in page.inner_text("#live-one caption")
    assert page.evaluate("document.activeElement.textContent") == rows[1][0]


def test_it_plays_pauses_and_shows_the_whole_section(page):
    clock = page.locator("#live-time")
    clock.focus()
    page.keyboard.press("Home")
    assert "outside the segments" in frame_words(page)
    page.locator("#live-speed").select_option("0.1")
    page.get_by_role("button", name="play").click()
    until(page, lambda: float(clock.input_value()) > 0.01)
    page.get_by_role("button", name="pause").click()
    near = picture(page, CLOSE)
    page.get_by_label("close to the block").uncheck()
    assert picture(page, CLOSE) != near
    page.keyboard.press("Space")
    assert picture(page, CLOSE) == near
    ask_for_release(page, 99999)
    assert frame_words(page) == "The page holds no frames of release 99999."


def test_the_view_opens_where_the_base_law_misses_most(page, diagnosed):
    worst = impact_misses(diagnosed, diagnosed.found.base.held_out).sigma.max()
    assert float(listed(page)[0].split(" σ")[0]) >= round(worst, 1)
    assert f"release {page.input_value('#live-release')}," in listed(page)[0]
    assert "segment" in frame_words(page) and "base law off by" in frame_words(page)


def test_a_check_says_its_place_among_the_replicates(page, diagnosed):
    checks = diagnosed.checks.all
    buttons = page.locator("#live-checks button")
    assert buttons.count() == len(checks)
    # the middle of what is drawn in the uppermost rows, where the mark is alone
    middle = "c => { const p = c.getContext('2d').getImageData(0, 1, c.width, 1).data; let sum = 0, n = 0;"
    middle += " for (let x = 0; x < c.width; x++) if (p[4 * x + 3] > 200) { sum += x + 0.5; n++; }"
    middle += " return sum / n / c.width }"
    marks = page.locator("#live-checks canvas").evaluate_all(f"all => all.map({middle})")
    most = max(max(check.value, check.percentiles[99]) for check in checks)
    assert marks == pytest.approx([check.value / most for check in checks], abs=0.012)
    for i, check in enumerate(checks):
        buttons.nth(i).focus() if i % 2 else buttons.nth(i).hover()
        said = page.inner_text("#live-check-said")
        low, _, high = check.replicates
        assert said.startswith(f"{check.name} (") and f"this film {check.value:.2f};" in said
        assert f"from {low:.2f} to {high:.2f}" in said and ("hardly" in said) == check.fails
        assert buttons.nth(i).get_attribute("aria-pressed") == "true"
        assert f"(p {p_text(check.p)})" in said


def test_the_address_holds_the_view(page, browser, report):
    tick(page, "inertia_error")
    page.locator("#live-zone").select_option("ditch")
    page.locator("#live-size").select_option("1.5 σ and more")
    page.locator("#live-item").select_option(index=2)
    page.get_by_role("button", name="frame on").click()
    page.get_by_label("close to the block").uncheck()
    until(page, lambda: "close=0" in page.url and "causes=inertia_error" in page.url)
    other, _ = opened(browser, report, page.url[page.url.index("#") :])
    for name in ("#live-zone", "#live-size", "#live-item", "#live-release"):
        assert other.input_value(name) == page.input_value(name) != ""
    assert other.inner_text("#live-model") == "Model: with inertia error"
    assert frame_words(other) == frame_words(page)
    assert not other.get_by_label("close to the block").is_checked()
    other.close()


def test_an_address_that_is_wrong_shows_the_page_as_it_opens(browser, report, page):
    other, seen = opened(browser, report, "#release=x&item=-1&zone=99&phase=7&size=a&t=never&causes=no,such")
    assert other.inner_text("#live-model") == "Model: base law" and other.input_value("#live-item") == ""
    assert other.input_value("#live-release") == page.input_value("#live-release")
    assert len(seen) == 1
    other.close()


def test_an_address_is_read_although_an_older_one_is_still_to_be_written(page):
    busy = "const end = performance.now() + 500; while (performance.now() < end);"  # both are due when it ends
    for i in range(4):  # which of them comes first is by chance
        page.locator("#live-item").select_option(index=1)
        page.evaluate(f"() => {{ setTimeout(() => {{ {busy} }}, 20) }}")
        page.wait_for_timeout(30)
        page.evaluate(f"() => {{ location.hash = '#visit=asked{i}' }}")
        page.wait_for_timeout(500)
        assert page.input_value("#live-item") == ""


def test_a_phone_shows_it_without_scrolling_sideways(page):
    with on_a_phone(page):
        page.locator("#live-item").select_option(index=1)
        until(page, lambda: page.locator(SECTION).first.get_attribute("width") == "362")


def test_it_is_not_printed_and_every_control_has_a_name(page):
    assert_not_printed_and_all_named(page)


def test_names_stay_text_and_nothing_is_loaded(watched, report):  # all others have used the page
    page, seen = watched
    assert page.locator("#live b").count() == page.locator("#live tr.live-model").count()
    assert_nothing_else_was_run_or_loaded(page, seen, report)


def test_what_does_not_fit_is_left_out_and_said(diagnosed, monkeypatch):
    content, found = diagnosis_json(diagnosed), diagnosed.found
    whole = live_gap.live_gap(diagnosed, content, [], {})
    monkeypatch.setattr(live_gap, "MOST_BYTES", len(whole["data"]) // 2)
    less = live_gap.live_gap(diagnosed, content, [], {})
    assert len(less["data"]) < 0.55 * len(whole["data"])
    held, every = (json.loads(less["data"])["frames"]["release"], json.loads(whole["data"])["frames"]["release"])
    assert f"holds {len(held)} of {len(every)} releases" in less["notes"][0] and len(whole["notes"]) == 1
    sizes = impact_misses(diagnosed, found.base.held_out).sigma
    monkeypatch.setattr(live_gap, "MOST_NUMBERS", 8000)
    least = live_gap.live_gap(diagnosed, content, [], {})
    assert len(json.loads(least["data"])["frames"]["release"]) < len(held)
    assert diagnosed.data.impact_release[np.argmax(sizes)] in held and 0 in held


def test_an_impact_lists_its_neighbours_and_each_can_be_chosen(page, diagnosed):
    ask_for_release(page, diagnosed.data.film.release_names[5])
    page.locator("#live-own tbody tr", has_text="impact").first.locator("button").click()
    rows = cells(page, "#live-neighbours tbody tr")
    block = page.inner_text("#live-one caption").split(", ")[1]
    assert len(rows) == 5 and all(f", {block}, impact, " in row[0] for row in rows)
    away = [float(row[1]) for row in rows]
    assert away == sorted(away) and away[0] >= 0.0
    page.locator("#live-neighbours button").first.click()
    assert page.inner_text("#live-one caption") == rows[0][0]
    back = [float(row[1]) for row in cells(page, "#live-neighbours tbody tr")]
    assert back[0] <= away[0]  # the nearest of the neighbour is no farther than the first impact is
