"""Passing, energies and heights of films whose motion is known; charts and words of their numbers."""

import numpy as np
import pytest

from rock2d.diagnosis.replay import Releases
from rock2d.diagnosis.report import practical_indicators
from rock2d.diagnosis.report.text import share_closed
from rock2d.graphics.bar_charts import Axis, axis_over
from rock2d.statistics import wilson_interval
from rock2d.wording import number, percent
from tests.kinematics.synthetic_films import film, world

G = 9.81
FPS = 500.0


@pytest.fixture(scope="module")
def experiment():
    return film(world(), 2)


def parabolas(speeds: np.ndarray, spin: float = 20.0) -> Releases:
    """Spheres thrown from the ditch at (0.02, 0.03) m with these horizontal speeds and 1.6 m/s upwards."""
    t = np.arange(170) / FPS
    t_s = np.tile(t, (len(speeds), 1))
    pose = np.stack(
        [0.02 + speeds[:, None] * t, np.tile(0.03 + 1.6 * t - 0.5 * G * t**2, (len(speeds), 1)), spin * t_s], axis=-1
    )
    zero = np.zeros(len(speeds), np.int64)
    return Releases(zero, np.arange(len(speeds)), zero, t_s, pose, zero + 10)


def of(quantities: list[practical_indicators.Quantity], title: str) -> dict[str, dict[str, list]]:
    rows = next(q for q in quantities if q.title.startswith(title)).rows
    return {row.place: row.models for row in rows}


def test_lines_stand_on_the_facing(experiment):
    lines, note = practical_indicators.measure_lines(experiment, 0.2)
    facing = experiment.cross_section.points_m[2:4]
    for line, share in zip(lines.values(), (1 / 3, 2 / 3, 1.0), strict=True):
        np.testing.assert_allclose(line[0], facing[0] + share * (facing[1] - facing[0]), atol=1e-12)
        assert line[1, 0] == line[0, 0] and line[1, 1] > 0.2
    assert "1/3" in note


def test_passing_energy_height_and_runout_of_parabolas(experiment):
    speeds = np.linspace(0.2, 1.0, 20)
    releases = parabolas(speeds)
    lines, _ = practical_indicators.measure_lines(experiment, 0.3)
    found = practical_indicators.film_quantities(experiment, releases, {"measured": releases.pose[None]}, lines)
    sphere = experiment.blocks["sphere"]
    end_s = releases.t_s[0, -1]
    passing, energy = of(found, "Passing"), of(found, "Kinetic")
    for name, line in lines.items():
        way = line[0, 0] - 0.02
        t = way / speeds
        y = 0.03 + 1.6 * t - 0.5 * G * t**2
        passed = (t < end_s) & (y > line[0, 1])
        (estimate,) = passing[name]["measured"]
        assert estimate.value == pytest.approx(100 * passed.mean())
        assert (estimate.low / 100, estimate.high / 100) == pytest.approx(wilson_interval(int(passed.sum()), 20))
        true = 0.5 * sphere.mass_kg * (speeds**2 + (1.6 - G * t) ** 2) + 0.5 * sphere.inertia_kg_m2 * 20.0**2
        if passed.sum() >= 8:
            values = [e.value for e in energy[name]["measured"]]
            np.testing.assert_allclose(
                values, 1e3 * np.percentile(true[passed], practical_indicators.COMPARED_PERCENTILES), rtol=0.02
            )  # mJ
    (height,) = of(found, "Bounce").values()
    assert height["measured"][0].value <= 1e3 * (0.03 + 1.6**2 / (2 * G)) + 1e-6
    (runout,) = of(found, "Runout").values()
    np.testing.assert_allclose(
        [e.value for e in runout["measured"]],
        1e3 * np.percentile(speeds * end_s, practical_indicators.COMPARED_PERCENTILES),
        rtol=1e-6,
    )


def test_repetitions_that_never_pass_still_have_an_upper_bound(experiment):
    releases = parabolas(np.full(10, 0.01))
    lines, _ = practical_indicators.measure_lines(experiment, 0.3)
    poses = np.repeat(releases.pose[None], 4, axis=0)
    found = practical_indicators.film_quantities(experiment, releases, {"base": poses}, lines)
    (estimate,) = of(found, "Passing")["crest"]["base"]
    assert estimate.value == 0.0 == estimate.low and 0.0 < estimate.high < 10.0


def test_axis_places_values():
    axis = Axis(0.0, 50.0)
    assert axis.at(25.0) == 50.0 and axis.at(-1.0) == 0.0 and axis.at(99.0) == 100.0
    bent = Axis(-100.0, 1e4, 10.0)
    assert bent.at(0.0) < bent.at(10.0) < bent.at(1e3) < bent.at(1e4) == 100.0
    for scale in (axis, bent, axis_over([3.0, np.nan, 4.0]), axis_over([])):
        ticks = scale.ticks()
        assert 1 < len(ticks) <= 6 and ticks == sorted(ticks)
        assert all(scale.low <= tick <= scale.high for tick in ticks)


def test_numbers_are_said_as_they_are_known():
    assert number(11004.3, 80.0) == "11 004"
    assert number(-0.034791, 0.0002) == "−0.03479"
    assert number(-0.0004, 30.0) == "0"
    assert number(float("nan")) == "–"
    assert percent(0.9999) == "more than 99 %" and percent(1e-5) == "less than 1 %"
    assert percent(0.57) == "57 %"
    assert share_closed(0.97, (0.951, 0.984)) == "97 % (95 to 98 %)"
    assert share_closed(-0.001, (-0.001, 0.012)) == "0 % (0 to 1 %)"
    assert share_closed(1.0, (1.0, 1.0)) == "100 %"
    assert share_closed(0.0, (0.0, 0.0)) == "nothing"
