"""The budget of the gap: shares that are known by hand, and a floor that near-replicates tell."""

from dataclasses import dataclass

import numpy as np
import pytest

from rock2d.diagnosis.budget import TRUE_FLOOR_RATIO, TRUE_FLOOR_SD, Budget, GapBootstrap, ResidualSizes, budget
from rock2d.diagnosis.data import Residuals
from rock2d.diagnosis.replicates import replicate_ratio
from rock2d.diagnosis.report.sections import budget_section

RELEASES = 40


@dataclass
class Segments:
    """As much of the data as a budget reads: one impact and one flight for each release."""

    order: np.ndarray
    impact_release: np.ndarray
    flight_release: np.ndarray
    impact_block: np.ndarray
    impact_zone: np.ndarray
    speed: np.ndarray

    @property
    def flown(self):
        return len(self.flight_release)

    def impact_quantities(self, world):
        zero = np.zeros(len(self.speed))
        names = ("tangential_speed_m_s", "spin_times_radius_m_s", "orientation_to_ground_rad", "x_m")
        return {"normal_speed_m_s": self.speed, **dict.fromkeys(names, zero)}


def segments(n: int, speed: np.ndarray | None = None) -> Segments:
    own, zero = np.arange(n), np.zeros(n, np.int64)
    return Segments(own, own, own, zero, zero, zero.astype(float) if speed is None else speed)


def logs(gap: float) -> np.ndarray:
    """Sums of logarithms of releases whose two segments both have this size."""
    return np.full(RELEASES, 2.0 * np.log(gap))


def found(gaps: dict[str, float], learnt: float, floor: float) -> Budget:
    """The budget of models, whose effects are the letters of their names, with these gaps."""
    own = GapBootstrap(ResidualSizes(segments(RELEASES), np.ones((RELEASES, 6, 6)) * np.eye(6)), seed=0)
    sets = {frozenset(names): logs(gap) for names, gap in gaps.items()}
    floors = own.gap(logs(floor)), own.gap(logs(floor))
    return budget(sets, frozenset(max(gaps, key=len)), logs(learnt), floors, own)


def test_causes_that_overlap_share_what_they_close_and_the_range_tells_the_orders():
    own = found({"": 4.0, "a": 2.0, "b": 2.0, "ab": 1.0}, learnt=1.0, floor=1.0)
    whole = 4.0 - TRUE_FLOOR_RATIO
    for name in "ab":
        assert own.causes[name].closes == pytest.approx(1.5 / whole)
        assert own.causes[name].range == pytest.approx((1.0 / whole, 2.0 / whole))
    assert own.closed.closes == pytest.approx(3.0 / whole)
    for names, gap in (("", 4.0), ("a", 2.0), ("b", 2.0), ("ab", 1.0)):
        left, together = own.sets[frozenset(names)]
        assert left == pytest.approx(gap) and together.closes == pytest.approx((4.0 - gap) / whole)


def test_a_small_gap_over_the_floor_says_little_about_shares():
    """What the true law would leave is known to some per cent only: of a gap of 10 % over it, a model that reaches the
    floor closes perhaps half, perhaps all; of a gap four times as large as the floor nearly all."""
    small = found({"": 1.10, "a": 1.0}, learnt=1.0, floor=1.0).closed
    large = found({"": 4.0, "a": 1.0}, learnt=1.0, floor=1.0).closed
    lowest = TRUE_FLOOR_RATIO * np.exp(-1.96 * TRUE_FLOOR_SD)
    assert small.ci95 == pytest.approx((0.10 / (1.10 - lowest), 1.0), abs=0.03)
    assert large.ci95 == pytest.approx((3.0 / (4.0 - lowest), 1.0), abs=0.01)
    assert small.ci95[0] < small.closes < small.ci95[1]


def test_shares_of_three_causes_sum_to_what_they_close_together():
    gaps = {"": 9.0, "a": 6.0, "b": 8.0, "c": 7.0, "ab": 5.5, "ac": 3.0, "bc": 6.5, "abc": 2.0}
    own = found(gaps, learnt=1.5, floor=1.0)
    whole = 9.0 - TRUE_FLOOR_RATIO
    assert sum(share.closes for share in own.causes.values()) == pytest.approx(7.0 / whole)
    # the mean over the six orders of a, b, c
    assert own.causes["a"].closes == pytest.approx((2 * 3.0 + 2.5 + 4.0 + 2 * 4.5) / 6 / whole)
    assert own.closed_by_learnt.closes == pytest.approx(0.5 / whole)


def test_the_first_and_the_last_place_count_where_not_all_orders_are_known():
    gaps = {"": 9.0, "a": 7.0, "b": 7.0, "c": 7.0, "d": 7.0, "bcd": 3.0, "acd": 3.0, "abd": 3.0, "abc": 3.0,
            "abcd": 1.0}  # fmt: skip
    own = found(gaps, learnt=1.0, floor=1.0)
    assert all(share.closes == pytest.approx(2.0 / (9.0 - TRUE_FLOOR_RATIO)) for share in own.causes.values())


def test_without_a_gap_nothing_closes():
    own = found({"": 1.0}, learnt=1.0, floor=1.0)
    assert own.closed.closes == 0.0 and own.closed.ci95 == (0.0, 0.0)


def test_the_units_of_a_segment_cancel_in_a_share():
    rng = np.random.default_rng(0)
    data = segments(RELEASES)
    small = Residuals(rng.normal(size=(RELEASES, 6)), np.zeros((RELEASES, 3, 5)))
    large = Residuals(2.0 * small.impacts, small.flights)
    ratios = []
    for unit in (0.5, 3.0):
        sizes = ResidualSizes(data, unit**2 * np.eye(6) * np.ones((RELEASES, 1, 1)))
        own = GapBootstrap(sizes, seed=0)
        ratios.append(own.gap(sizes.of(large))[0] / own.gap(sizes.of(small))[0])
    # half of the segments are twice as large
    assert ratios[0] == pytest.approx(ratios[1]) == pytest.approx(np.sqrt(2.0))


def test_near_replicates_tell_the_noise_below_a_curve_that_no_model_follows():
    rng = np.random.default_rng(1)
    n = 300
    speed = rng.uniform(0.0, 1.0, n)
    noise = rng.normal(0.0, 0.5, (n, 6))
    missed = noise + np.sin(12.0 * speed)[:, None]
    data = segments(n, speed)
    ratio = replicate_ratio(data, None, missed)
    assert ratio.value == pytest.approx(0.25 / (missed**2).mean(), rel=0.25)
    assert ratio.value <= ratio.upper_bound < 0.6


def test_near_replicates_of_pure_noise_leave_all_of_it():
    rng = np.random.default_rng(2)
    data = segments(200, rng.uniform(0.0, 1.0, 200))
    assert replicate_ratio(data, None, rng.normal(size=(200, 6))).upper_bound > 0.9


def test_the_page_says_which_effects_of_the_learnt_part_are_not_certain():
    closed = {"closes": 0.5, "closes_ci95": [0.4, 0.6]}
    parameters = {"drag_per_mass_1_m": {"value": 0.173, "ci95": [0.153, 0.193], "unit": "1/m"}}
    content = {
        "verdict": "unknown",
        "gap": {"base": 1.0, "noise_floor": 0.5},
        "floor": {"regression": 0.5, "replicates": 0.6, "used": 0.5},
        "causes": [closed | {"effect": "air_drag", "origin": "flight", "group": [], "parameters": parameters}],
        "outside": {
            "share": 0.3,
            "learnt": {
                "closes": 0.3,
                "closes_ci95": [0.2, 0.4],
                "changes": ["law of spin"],
                "effects": ["angle_offset"],
            },
        },
    }
    assert [(name, said) for name, _, _, said in budget_section(content)["budget_rows"]] == [
        ("air drag 0.173 1/m", "50 % (40 to 60 %)"),
        ("learnt: law of spin, with angle offset (not certain)", "30 % (20 to 40 %)"),
        ("not explained", "20 %"),
    ]
