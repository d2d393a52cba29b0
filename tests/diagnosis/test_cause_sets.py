"""Sets of causes: films with two hidden effects, and with none. The engine is the same, so answers must be exact."""

import copy
from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from rock2d.diagnosis import cause_sets
from rock2d.diagnosis.base_law import fit_base
from rock2d.diagnosis.cause_sets import Reduction, Search
from rock2d.diagnosis.cross_validation import Validated, by_release, rests_z
from rock2d.diagnosis.data import FilmData, Residuals
from rock2d.diagnosis.evidence import LARGEST_LUCK, SURE_GAIN, gain_beyond_luck, probability_of_no_closure
from rock2d.diagnosis.exploring import REFIT_GAIN, explore_on_some, fit_effects, total_on_some
from rock2d.diagnosis.fitting import CONVERGED_GAIN, Convergence, Fit, extended, fit
from rock2d.diagnosis.likelihood import PRIOR_SCATTER, posterior_cost
from rock2d.diagnosis.model import BASE_WIDTH, Model
from rock2d.diagnosis.workload import DiagnosisBars
from rock2d.effects import catalogue
from rock2d.effects.camera import MIRROR_THETA
from rock2d.effects.ground import EMBANKMENT, FACING
from rock2d.kinematics.setup_world import base_law_start
from rock2d.processes import Processes
from tests.kinematics.synthetic_films import START, base_fit, data_of, effects, film, series_order, with_causes, world

RELEASES, FEW = 16, 10  # per block; ten tell apart what strong effects do
TRIED = ("camera_tilt", "zone_contrast", "angle_offset", "inertia_error")
HIDDEN = {"camera_tilt": [0.03, 0.0, 0.0], "zone_contrast": [0.4, 1.0, 1.0, FACING]}


def tried_alone(hidden: dict[str, list[float]], tried: Sequence[str] = TRIED, releases: int = RELEASES) -> Search:
    experiment = film(with_causes(world(series_order(releases)), hidden), releases, seed=7)
    data, base = base_fit(experiment, base_law_start(experiment))
    with Processes(1, (data,)) as processes:
        bars = DiagnosisBars(False, len(tried), 1)
        search = Search(data, effects(*tried), processes, Validated.of(base, data), bars)
        search.try_alone()
    return search


def searched(hidden: dict[str, list[float]]) -> Search:
    search = tried_alone(hidden)
    search.run()
    return search


@pytest.fixture(scope="module")
def two() -> Search:
    return searched(HIDDEN)


def test_two_hidden_effects_are_found_and_measured(two):
    assert two.best.names == set(HIDDEN)
    model = two.best.fit.model
    found = dict(zip((e.name for e in model.effects), model.values(two.best.fit.p), strict=True))
    for name, values in HIDDEN.items():
        assert found[name][0] == pytest.approx(values[0], rel=0.15)
    assert found["zone_contrast"][-1] == FACING
    for smaller in two.without(two.best).values():
        assert two.gain(two.best, smaller).significant


def test_a_reduction_that_is_stuck_below_the_smaller_set_starts_again_from_there(two, monkeypatch):
    """Learnt changes can only add to what the smaller set explains."""
    smaller = two.without(two.best)["camera_tilt"].fit
    stuck = replace(smaller, residuals=Residuals(3.0 * smaller.residuals.impacts, 3.0 * smaller.residuals.flights))
    starts = list[np.ndarray]()

    def fitted(model, data, start, old):
        starts.append(start)
        return stuck if len(starts) == 1 else smaller

    monkeypatch.setattr(cause_sets, "fit", fitted)
    assert Reduction(two.best.fit, "camera_tilt").fitted(two.data) is stuck and len(starts) == 1
    starts.clear()
    assert Reduction(two.best.fit, "camera_tilt", smaller).fitted(two.data) is smaller
    assert starts[1] == pytest.approx(smaller.p)


def test_a_smaller_set_in_a_worse_optimum_is_fitted_again_from_the_larger_one(two):
    """Else a member that only leads out of that optimum would seem to gain. A fit that ends lower is dropped."""
    search, known = copy.copy(two), two.without(two.best)["camera_tilt"]
    worse = Residuals(10.0 * known.fit.residuals.impacts, 10.0 * known.fit.residuals.flights)
    stuck = replace(known, fit=replace(known.fit, residuals=worse))
    for before, kept in ((known, True), (stuck, False)):
        search.known, search.reduced = {**two.known, known.names: before}, set()
        again = search.without(search.best)["camera_tilt"]
        assert (again is before) == kept
        assert search.known[known.names] is again and search.without(search.best)["camera_tilt"] is again
    assert again.fit.total() > stuck.fit.total() + REFIT_GAIN


def test_a_set_that_was_forgotten_is_fitted_again(two, monkeypatch):
    """A smaller set that is fitted better makes larger ones unknown that began at the old fit, among them the set to
    which a member was just added."""
    search = copy.copy(two)
    search.known, search.reduced = dict(two.known), set()
    search.best = search.set_of(before := frozenset({"camera_tilt", "angle_offset"}))
    monkeypatch.setattr(Search, "_prune", lambda self, kept: self.known.pop(before, None))
    search._grow()
    assert search.best.names >= set(HIDDEN) and before in search.known


def test_a_strong_cause_is_found_where_all_its_impacts_are_far_beyond_the_noise():
    """Without noise the base law fits the impacts beside the embankment exactly, and misses the others by hundreds of
    standard errors."""
    values = [0.26, 0.51, 1.3, EMBANKMENT]
    true = with_causes(world(), {"zone_contrast": values})
    setup, data = data_of(film(true, 12, seed=3, noise_m=4e-6, noise_rad=4e-4, soil=0.0))
    base = fit_base(setup, START, data)
    model = Model(base.model.setup, base.model.base, list(effects("zone_contrast").values()), base.p)
    found = fit_effects(model, data, base, explore_on_some(model, data, base, total_on_some(base, data)))
    assert model.values(found.p)[0] == pytest.approx(values, rel=0.02)


@pytest.mark.parametrize("tilt_rad", [0.0, 0.0006])
def test_a_small_gain_counts_as_far_as_the_linear_model_expects_it(tilt_rad):
    """The fit of a true effect gains what the linear model expects. A gain of 8 without an effect can only be luck."""
    search = tried_alone({"camera_tilt": [tilt_rad, 0.0, 0.0]} if tilt_rad else {}, ("camera_tilt",))
    search.best = search.alone["camera_tilt"]
    gain = search.gain(search.best, search.base).total if tilt_rad else 0.8 * LARGEST_LUCK
    counted = gain_beyond_luck(search, "camera_tilt", gain)
    assert counted == pytest.approx(gain, rel=0.3) if tilt_rad else counted < 0.3 * gain
    assert 5.0 < gain < SURE_GAIN
    assert tilt_rad or gain_beyond_luck(search, "camera_tilt", 3.0 * LARGEST_LUCK) == 2.0 * LARGEST_LUCK
    assert gain_beyond_luck(search, "camera_tilt", 2.0 * SURE_GAIN) == 2.0 * SURE_GAIN


def test_a_fit_that_stayed_near_no_effect_starts_again_from_its_twin():
    """Lengths that are 5 % too long, and times that are 2.5 % too long, change gravity alike. The tilt beside them is
    taken over."""
    hidden = {"scale_error": [1.05, 1.0, 0.0, 0.0], "camera_tilt": [0.03, 0.0, 0.0]}
    search = tried_alone(hidden, ("scale_error", "frame_rate_error", "camera_tilt"), FEW)
    tilted = search.alone["camera_tilt"]
    search._with_each(["frame_rate_error"], tilted)
    of_scale = search._with_each(["scale_error"], tilted)[0]
    stuck_at = extended(tilted.fit, of_scale.fit.model)
    stuck = replace(of_scale, fit=replace(of_scale.fit, p=stuck_at, residuals=tilted.fit.residuals))
    search.known[stuck.names] = stuck
    search._fit_from_twins([stuck])
    again = search.known[stuck.names]
    found = dict(zip(again.fit.model.positions, again.fit.model.values(again.fit.p), strict=True))
    assert found["scale_error"][0] == pytest.approx(1.05, rel=0.01)
    assert found["camera_tilt"][0] == pytest.approx(0.03, rel=0.1)
    assert again.fit.total() == pytest.approx(of_scale.fit.total(), abs=5.0)


@pytest.mark.parametrize(
    "hidden",
    [
        {"scale_error": [1.04, 1.0, 0.0, 0.0], "frame_rate_error": [0.97]},
        {"scale_error": [1.04, 1.0, 0.0, 0.0], "frame_rate_error": [1.04**-0.5]},
        {"scale_error": [1.04, 1.0, 0.0, 0.0]},
        {"frame_rate_error": [0.97]},
    ],
)
def test_a_set_holds_both_twins_only_where_contacts_need_both(hidden):
    """Gravity in flights shows one common quantity; where and how fast blocks strike shows the other. A frame rate that
    was set by gravity hides a wrong scale in flights, so neither gains alone."""
    search = tried_alone(hidden, ("scale_error", "frame_rate_error", "camera_tilt"), FEW)
    search.run()
    model = search.best.fit.model
    found = dict(zip(model.positions, model.values(search.best.fit.p), strict=True))
    assert found.keys() == hidden.keys()
    assert [found[name][0] for name in hidden] == pytest.approx([own[0] for own in hidden.values()], rel=0.003)


def test_only_rests_say_how_far_rests_prefer_a_set():
    """The height of a block in one row, in standard deviations; the flight before it does not count."""
    data = SimpleNamespace(flown=1)

    def of(flight: float, height: float) -> SimpleNamespace:
        flights = np.zeros((2, 3, 5))
        flights[:, 1, 0] = flight, height
        return SimpleNamespace(held_out=SimpleNamespace(residuals=Residuals(np.empty((0, 6)), flights)))

    lies, floats = of(9.0, 0.0), of(0.0, 1.0)
    assert rests_z(data, lies, floats) == pytest.approx(1.0, rel=0.1)  # nearly normal
    assert rests_z(data, floats, lies) == -rests_z(data, lies, floats)
    assert rests_z(data, lies, of(0.0, 12.0)) < 6.0  # heavy tails: a single block does not decide all
    assert rests_z(data, lies, of(0.0, 0.0)) == 0.0


def test_an_effect_that_closes_a_part_only_beside_what_is_learnt_closes_it(two):
    """Neither alone nor in the set does it close anything here."""
    base, tilted = two.base, two.alone["camera_tilt"]
    search = SimpleNamespace(
        data=two.data, base=base, best=base, alone={"camera_tilt": base}, without=lambda _: {"camera_tilt": base}
    )
    assert probability_of_no_closure(search, "camera_tilt", base, base) == 1.0
    assert probability_of_no_closure(search, "camera_tilt", tilted, base) < 0.01


def test_screening_expects_most_of_the_effect_that_is_there(two):
    """Beside one of two hidden effects. It promises less than a fit gains: the contrast moves impacts so far that they
    count little in a robust likelihood. One Newton step expects nothing of it."""
    for name, other in (("camera_tilt", "zone_contrast"), ("zone_contrast", "camera_tilt")):
        own = two.known[frozenset({name})]
        expected = {key: found.promise for key, found in two.expected_beside(own).items()}
        assert max(expected, key=lambda key: expected[key]) == other
        assert expected[other] > 2.0 * max(expected["inertia_error"], expected["angle_offset"], 1.0)
        assert expected[other] < 1.5 * two.gain(two.best, own).total


def test_a_fit_far_behind_its_rival_stops_early(two, monkeypatch):
    """A rival within reach changes nothing. No fit ends below its start in what it makes largest, the posterior."""
    base, simulated = two.base.fit, []
    model = Model(base.model.setup, base.model.base, [catalogue()["angle_offset"]], base.p)
    plain = FilmData.residuals
    monkeypatch.setattr(FilmData, "residuals", lambda *a: simulated.append(0) or plain(*a))

    def fitted(rival_total: float) -> tuple[Fit, int]:
        simulated.clear()
        return fit(
            model, two.data, extended(base, model), old=base, convergence=Convergence(rival_total=rival_total)
        ), len(simulated)

    (alone, all_steps), (near, same), (far, fewer) = map(fitted, (-np.inf, base.total() + 5.0, base.total() + 1e5))
    assert (near.p == alone.p).all() and same == all_steps
    assert fewer < all_steps
    assert far.total() <= alone.total() + CONVERGED_GAIN

    def cost(found: Fit) -> float:
        of_scatter = 0.5 * ((found.scatter / PRIOR_SCATTER) ** 2).sum()
        return posterior_cost(model, found.p, found.residuals, found.covariance()) + of_scatter

    assert cost(alone) <= cost(far) <= cost(replace(base, model=model, p=extended(base, model)))


def test_a_twin_is_fitted_before_it_counts_as_told_apart():
    """What screening expects of a twin can be far too little. Gravity in the flights, which both explain, is most of
    the gain; a twin that gains all but a quarter of it stays within one standard error. So are rivals that are
    asked for."""
    hidden = {"inertia_error": [1.5], "frame_rate_error": [1.05]}
    search = tried_alone(hidden, (*hidden, "scale_error", "angle_offset"), FEW)
    search.best = search.set_of(frozenset(hidden))
    search.find_rivals(search.best, "frame_rate_error", np.inf)
    smaller, both = search.without(search.best)["frame_rate_error"], search.best
    twin = search.known[frozenset({"inertia_error", "scale_error"})]
    lead, gain = search.gain(both, twin), search.gain(both, smaller).total
    z = search.find_rivals(search.best, "frame_rate_error", np.inf).get("scale_error", np.inf)
    own = min(lead.significance, lead.total / (0.25 * gain)) + rests_z(search.data, both, twin)
    assert z == (own if lead.total <= 0.5 * gain else np.inf)
    assert 0.0 < lead.total < gain
    beside = frozenset({"frame_rate_error", "angle_offset"})
    assert beside not in search.known
    search.find_rivals(search.best, "inertia_error", np.inf, ["angle_offset"])
    assert beside in search.known
    # scale_error beside its twin is fitted before it counts, however much it promises
    without = search.without(search.best)["inertia_error"]
    promising = replace(
        search.expected_beside(without)["scale_error"], gain=2.0 * search.gain(both, without).gain, promise=99.0
    )
    search.expected[without.names]["scale_error"] = promising
    assert "scale_error" not in search.find_rivals(search.best, "inertia_error", np.inf)


def test_no_effect_makes_the_empty_set():
    search = searched({})
    assert search.best.names == set()
    assert max(search.gain(own, search.base).total for own in search.alone.values()) < 10.0


def test_the_order_in_which_effects_are_tried_does_not_matter(two):
    tried = dict(reversed(two.effects.items()))
    again = Search(two.data, tried, Processes(1, (two.data,)), two.base, two.bars)
    again.try_alone()
    again.run()
    assert again.best.names == two.best.names
    assert np.abs(again.best.held_out.score - two.best.held_out.score).max() < 1.0


def test_the_same_predictions_with_other_covariances_are_no_surer(two):
    """What two fits find of the scatter differs by chance; how sure a gain is comes from what they predict."""
    best, less = two.best, next(iter(two.without(two.best).values()))
    wider = Validated(replace(best.fit, scatter=2.0 * best.fit.scatter), best.held_out)
    score = by_release(two.data, best.held_out.residuals, wider.fit.covariance())
    wider.held_out = replace(best.held_out, score=score)
    assert np.abs(score - best.held_out.score).sum() > 10.0
    assert two.gain(wider, best).by_means == pytest.approx(0.0, abs=1e-9)
    assert two.gain(wider, best).significance == pytest.approx(0.0, abs=1e-9)
    assert two.gain(best, less).by_means == pytest.approx(-two.gain(less, best).by_means)


def test_a_mirrored_angle_is_found_although_the_base_law_has_adapted_to_it():
    """The law that fits spins of the wrong sign is too far away to find the right one from there."""
    true = catalogue()["mirrored_axis"].apply(world(series_order(RELEASES)), [float(MIRROR_THETA)])
    experiment = film(true, RELEASES, seed=7)
    (setup, data), start = data_of(experiment), base_law_start(experiment)
    base = fit(Model(setup, start), data, np.array([0.0, 0.0, 0.0, -1.0, 5.5]))
    model = Model(setup, start, [catalogue()["mirrored_axis"]], base.p)
    found = fit_effects(model, data, base, explore_on_some(model, data, base, total_on_some(base, data)))
    assert model.values(found.p) == [[MIRROR_THETA]]
    assert np.abs(found.p[: len(BASE_WIDTH)]).max() < 0.5


def test_a_mirrored_axis_that_gains_nothing_alone_is_fitted_as_a_mirror(two):
    """Beside another strong cause it may gain all: without a choice it would not be tried there."""
    base, data = two.base.fit, two.data
    model = Model(base.model.setup, base.model.base, [catalogue()["mirrored_axis"]], base.p)
    found = fit_effects(model, data, base, explore_on_some(model, data, base, total_on_some(base, data)))
    assert found.total() < base.total() and model.values(found.p)[0][0] in (1.0, 2.0, 3.0)


def test_effects_that_replace_each_other_in_turn_come_to_an_end(two, monkeypatch):
    """Each gains beside the other and then makes it needless; without an end this test would not end."""
    search, both = copy.copy(two), two.best
    search.best = search.known[frozenset({"camera_tilt"})]
    monkeypatch.setattr(search, "promising_additions", lambda *given: [both])
    monkeypatch.setattr(cause_sets, "LEAST_SCATTER_GAIN", np.inf)
    monkeypatch.setattr(search, "_prune", lambda kept: setattr(search, "best", search.known[kept]))
    search._grow()
    assert search.best.names == {"camera_tilt"}


@pytest.mark.parametrize(("member", "exchanged"), [("keystone_distortion", True), ("angle_offset", False)])
def test_a_smooth_distortion_is_exchanged_for_two_causes_that_gain_more(member, exchanged):
    """In real film a turned picture over inclined ground: a keystone gains more than either, and less than both."""

    def cause_set(total, *names):
        return SimpleNamespace(names=frozenset(names), fit=SimpleNamespace(total=lambda: total))

    best, nothing, tilted = cause_set(50.0, member), cause_set(0.0), cause_set(40.0, "camera_tilt")
    both = cause_set(70.0, "camera_tilt", "geometry_error")
    additions = {nothing.names: [tilted], tilted.names: [both]}
    search = SimpleNamespace(
        best=best,
        without=lambda own: {member: nothing},
        promising_additions=lambda own, *further: list(additions[own.names]),
        gain=lambda one, other: SimpleNamespace(total=one.fit.total() - other.fit.total()),
    )
    assert Search._exchange(search) == exchanged
    assert (search.best is both) == exchanged
