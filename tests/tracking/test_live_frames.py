"""The live view of a tracked film, in a browser: every control does its work, the numbers are those of the tables."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from rock2d_tracking.live_frames import IMPORTANT_RATIO, flight_and_impact_rows, frame_pictures, shown_rows
from rock2d_tracking.setup_file import write_setup
from rock2d_tracking.sights import REASONS
from rock2d_tracking.synthetic.faults import CLEAN
from rock2d_tracking.synthetic.film import FilmOptions, film_frames, write_film

from rock2d.files.experiment import load_experiment
from tests.browsing import (
    CONTROLS,
    assert_not_printed_and_all_named,
    assert_nothing_else_was_run_or_loaded,
    assert_only_its_own_script_may_run,
    on_a_phone,
    opened,
    until,
)
from tests.docs.sources import DOCS
from tests.tracking.falls import CAMERA, SIZE_PX, falls
from tests.tracking.test_command import tracked

REST, FRAMES = 40, 140
COVERED = range(2 * REST + FRAMES + 100, 2 * REST + FRAMES + 103)  # frames of the second release without its block


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A tracked film of three releases, in one of which the block is away for three frames."""
    folder = tmp_path_factory.mktemp("live")
    experiment = falls(FRAMES)
    options = FilmOptions(seed=1, faults=CLEAN, rest_frames=REST)
    shots = list(film_frames(experiment, CAMERA, SIZE_PX, options))
    shots = [replace(s, image=shots[0].image) if k in COVERED else s for k, s in enumerate(shots)]
    write_film(folder / "film.avi", shots, SIZE_PX, 25, 90)
    write_setup(folder / "setup.yaml", experiment, CAMERA, ["sphere", "cube", "slab"])
    tracked(folder / "film.avi", folder / "setup.yaml", folder / "out")
    return folder / "out"


@pytest.fixture(scope="module")
def frames(folder):
    """frames.csv with the positions of trajectories.csv."""
    table = pd.read_csv(folder / "frames.csv", keep_default_na=False, na_values={"u_px": [""], "v_px": [""]})
    places = load_experiment(folder).trajectories[["release", "t_s", "x_m", "y_m", "theta_rad"]]
    return table.merge(places, on=["release", "t_s"], how="left")


@pytest.fixture(scope="module")
def watched(browser, folder):
    return opened(browser, folder / "tracking.html")


@pytest.fixture
def page(watched):
    """The page at the first frame of the second release."""
    go(watched[0], 1, 0)
    return watched[0]


def go(page, release: int, frame: int) -> None:
    there = f"`#release={release}&frame={frame}&visit=${{performance.now()}}`"  # the page listens before this promise
    page.evaluate(
        f"() => new Promise(done => {{ addEventListener('hashchange', () => done(), {{ once: true }}); "
        f"location.hash = {there} }})"
    )
    until(page, lambda: page.input_value("#live-release") == str(release) and shown(page) >= frame)


def shown(page) -> int:
    """Number of the frame that is shown."""
    return int(re.match(r"Frame (\d+):", page.inner_text("#live-said"))[1])


def facts(page) -> dict[str, str]:
    rows = page.eval_on_selector_all(
        "#live-table tbody tr", "all => all.map(r => [r.cells[0].textContent, r.cells[1].textContent])"
    )
    return dict(rows)


def test_every_frame_says_what_the_tables_say(page, frames):
    checked = frames.iloc[np.r_[0:420:23, 239:247]]
    assert {"hidden", ""} & set(checked["reason"]) and (checked["reason"] != "").any()
    for own in checked.itertuples():
        go(page, own.release, own.frame)
        said = facts(page)
        assert said["frame, time"].startswith(f"frame {own.frame} of the film, {own.t_s:g} s")
        if own.reason:
            assert said["why"] == f"lost: {own.reason}. {REASONS[own.reason].replace('`', '')}"
            assert said["in metres"] == "not trusted"
            continue
        number = r"(-?[\d.e-]+)"
        u, du, v, dv = map(float, re.match(
            rf"u = {number} ± {number} px, v = {number} ± {number} px", said["in the picture"]).groups())  # fmt: skip
        assert (u, v) == (pytest.approx(own.u_px, abs=0.006), pytest.approx(own.v_px, abs=0.006))
        assert (du, dv) == pytest.approx((float(own.u_error_px), float(own.v_error_px)), rel=0.06)
        x, y = map(float, re.match(rf"x = {number} m, y = {number} m", said["in metres"]).groups())
        assert (x, y) == pytest.approx((own.x_m, own.y_m), abs=6e-5)
        turn, off = map(float, re.match(rf"{number}° ± {number}°", said["angle"]).groups())
        assert turn == pytest.approx(np.rad2deg(own.theta_rad), abs=0.06)
        assert np.deg2rad(off) == pytest.approx(float(own.angle_error_rad), rel=0.06)
        seen = float(re.match(r"trusted: (\d+)\s% of the outline", said["why"])[1])
        assert seen == pytest.approx(100 * own.confidence, abs=0.56)  # rounded twice


def test_a_frame_says_its_flight_and_its_impact(page, folder, frames):
    flights, impacts = (pd.read_csv(folder / f"{n}.csv") for n in ("flights", "measured_impacts"))
    own = impacts[impacts["release"] == 1].iloc[0]
    page.get_by_role("button", name="next impact").click()
    said = facts(page)
    assert own["t_s"] == pytest.approx(float(said["frame, time"].split(", ")[1].split(" s")[0]), abs=0.02)
    assert said["impact"].startswith(f"1: at {own['t_s']:.4g} s on ditch, restitution {own['restitution']:.3f} ± ")
    flight = flights[flights["release"] == 1].iloc[0]
    go(page, 1, int(frames[frames["release"] == 1]["frame"].iloc[0]) + 5)
    assert facts(page)["flight"].startswith(f"1 of 2: {flight['begin_s']:.4g} to {flight['end_s']:.4g} s, ")
    assert facts(page)["impact"] == "none"


def test_no_number_is_minus_zero(page):
    """Positions are near 0 where the block crosses the origin."""
    numbers = "[-4e-5, -0.04, -0.06, 2.5].map((v) => live.fixed(v, 1))"
    assert page.evaluate(numbers) == ["0.0", "0.0", "-0.1", "2.5"]


def test_the_page_counts_the_flags_of_impacts_alone(page, folder):
    impacts = pd.read_csv(folder / "measured_impacts.csv", keep_default_na=False)
    own = impacts.loc[impacts["flag"] != "mid-air", "flag"]
    counts = ", ".join(f"{word} {own.str.contains(word).sum()}" for word in ("deep", "low", "wide gap"))
    said = f"{(own != '').sum()} of {len(own)} ({counts}; flags of measured_impacts.csv"
    assert said in page.inner_text("body")


def test_frames_belong_to_the_impact_between_two_flights():
    flights = pd.DataFrame({"release": [0, 0, 1], "begin_s": [0.0, 0.6, 0.0], "end_s": [0.4, 1.0, 1.0]})
    impacts = pd.DataFrame({"release": [0], "t_s": [0.5]})
    frames = pd.DataFrame({"release": [0] * 6 + [1], "t_s": [0.0, 0.4, 0.5, 0.6, 1.0, 1.1, 0.5]})
    flight, impact = flight_and_impact_rows(frames, flights, impacts)
    assert flight.tolist() == [0, 0, -1, 1, 1, -1, 2]
    assert impact.tolist() == [-1, 0, 0, 0, -1, -1, -1]


def test_the_outline_lies_on_the_block(page, frames):
    own = frames[(frames["release"] == 1) & (frames["reason"] == "")].iloc[30]
    go(page, 1, own["frame"])
    corners = np.array([p.split(",") for p in page.get_attribute("#live-near polygon", "points").split()], float)
    assert corners.mean(axis=0) == pytest.approx((own["u_px"], own["v_px"]), abs=1e-3)
    side = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1)
    assert side == pytest.approx(np.full(4, 0.019 / CAMERA.metres_per_pixel), rel=0.02)
    box = page.get_attribute("#live-near", "viewBox").split()
    assert float(box[0]) + float(box[2]) / 2 == pytest.approx(own["u_px"], abs=1e-3)
    left = float(page.get_attribute("#live-near image", "x"))
    width = float(page.get_attribute("#live-near image", "width"))
    assert left < own["u_px"] < left + width
    assert page.get_attribute("#live-near image", "href").startswith("data:image/webp;base64,")


def test_buttons_step_and_jump_to_lost_frames(page, frames):
    start = shown(page)
    page.get_by_role("button", name="step on").click()
    assert shown(page) == start + 1
    page.get_by_role("button", name="step back").click()
    assert shown(page) == start
    lost = frames[(frames["release"] == 1) & (frames["reason"] != "")]["frame"].tolist()
    assert set(COVERED) <= set(lost)
    for frame in lost:
        page.get_by_role("button", name="next lost frame").click()
        assert shown(page) == frame and "lost" in page.inner_text("#live-said")
        assert "lost" in (page.get_attribute("#live-near polygon", "class") or "")
    page.get_by_role("button", name="next lost frame").click()
    assert page.inner_text("#live-said").startswith("no further one after")
    page.get_by_role("button", name="lost frame before").click()
    assert shown(page) == lost[-2]


def test_it_plays_at_the_chosen_speed_and_stops_at_the_end(page, frames):
    page.locator("#live-speed").select_option("0.05")
    start = shown(page)
    page.get_by_role("button", name="play").click()
    until(page, lambda: shown(page) > start + 10)
    page.get_by_role("button", name="pause").click()
    page.locator("#live-speed").select_option("1.0")
    page.get_by_role("button", name="play").click()
    last = int(frames[frames["release"] == 1]["frame"].iloc[-1])
    until(page, lambda: shown(page) == last and page.inner_text("#live-play") == "play")


def test_the_keyboard_steps_jumps_and_plays(page, frames):
    own = frames[frames["release"] == 1]
    start, last = int(own["frame"].iloc[0]), int(own["frame"].iloc[-1])
    page.locator("#live-pictures").focus()
    for key, expected in (("ArrowRight", start + 1), ("ArrowLeft", start), ("End", last), ("Home", start),
                          ("l", COVERED[0])):  # fmt: skip
        page.keyboard.press(key)
        assert shown(page) == expected, key
    page.keyboard.press("Home")
    page.keyboard.press("i")
    met = shown(page)
    assert "restitution" in facts(page)["impact"]
    page.keyboard.press("End")
    page.keyboard.press("Shift+I")
    assert shown(page) == met
    page.locator("#live-time").focus()
    page.keyboard.press("ArrowRight")
    assert shown(page) == met + 1
    page.keyboard.press("Home")  # so that it does not play to the end before the next key
    page.keyboard.press(" ")
    assert page.inner_text("#live-play") == "pause"
    page.keyboard.press(" ")
    assert page.inner_text("#live-play") == "play"


def test_a_click_on_the_path_goes_to_its_frame(page, frames):
    own = frames[(frames["release"] == 1) & (frames["reason"] == "")].iloc[20]
    film = page.locator("#live-film")
    scale = film.bounding_box()["width"] / SIZE_PX[0]
    film.click(position={"x": (own["u_px"] + 0.5) * scale, "y": (own["v_px"] + 0.5) * scale})
    assert shown(page) == own["frame"]
    assert page.locator("#live-film circle").count() == frames[frames["release"] == 1]["u_px"].notna().sum()


def test_a_release_is_chosen(page, frames):
    page.locator("#live-release").select_option(label="2: slab, 140 frames, 0 lost")
    assert shown(page) == frames[frames["release"] == 2]["frame"].iloc[0]
    assert len(page.get_attribute("#live-near polygon", "points").split()) == 4


def test_the_address_holds_release_and_frame(page, browser, folder):
    page.get_by_role("button", name="next lost frame").click()
    until(page, lambda: page.url.endswith(f"#release=1&frame={COVERED[0]}"))
    other, _ = opened(browser, folder / "tracking.html", page.url[page.url.index("#") :])
    assert shown(other) == COVERED[0] and facts(other) == facts(page)
    other.goto(page.url.split("#")[0] + "#release=nonsense&frame=-3")
    assert other.locator("#live-table").is_visible()
    other.close()


def test_a_phone_shows_it_without_scrolling_sideways_and_cuts_no_table(page):
    with on_a_phone(page):
        assert page.eval_on_selector_all(".scroll", "all => all.every(s => s.scrollWidth <= s.clientWidth)")


def test_without_a_script_or_on_paper_the_page_is_as_before(page, browser, folder):
    assert page.locator(CONTROLS).count() == 10
    assert_not_printed_and_all_named(page, 10)
    plain = browser.new_context(java_script_enabled=False).new_page()
    plain.goto((folder / "tracking.html").as_uri())
    assert plain.locator("#live").is_hidden() and plain.locator("figure img").count() == 5
    plain.close()


def test_only_its_own_script_runs_and_nothing_is_loaded_but_the_overlay(watched, folder):  # after all others
    page, seen = watched
    assert_only_its_own_script_may_run((folder / "tracking.html").read_text(encoding="utf-8"))
    assert page.evaluate("document.querySelector('video').error") is None
    assert_nothing_else_was_run_or_loaded(page, seen, folder / "tracking.html", folder / "overlay.webm")


def test_pictures_that_do_not_fit_are_left_out_but_not_the_important_ones():
    rng = np.random.default_rng(0)
    film = [rng.integers(0, 255, (60, 80), dtype=np.uint8) for _ in range(64)]
    numbers, places = np.arange(64), np.full((64, 2), 30.0)
    important = np.isin(numbers, [3, 21])
    all_of_them = frame_pictures(film, numbers, places, np.full(64, 5.0), important, 10**9)
    assert all_of_them.stride == 1 and len(all_of_them.images) == 64
    assert (all_of_them.boxes_px == [10, 10, 41, 41]).all()
    size = sum(map(len, all_of_them.images))
    some = frame_pictures(film, numbers, places, np.full(64, 5.0), important, size // 3)
    assert some.stride == 4 and {3, 21} <= set(some.rows) and sum(map(len, some.images)) < size // 3
    assert shown_rows(np.full(64, True), 4 * IMPORTANT_RATIO).sum() == 16  # also of important ones some are left out


def test_the_guide_explains_every_reason():
    guide = (DOCS / "guide" / "own-film.md").read_text(encoding="utf-8")
    assert dict(re.findall(r"^\| `([a-z ]+)` \| (.*\.) \|$", guide, re.MULTILINE)).items() >= REASONS.items()
