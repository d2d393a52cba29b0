"""Evidence: what chance gives, what imitates, and what shares a name."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.special import ndtr

from rock2d.diagnosis import attribution, evidence
from rock2d.diagnosis.attribution import WeighedSet, inclusion_probabilities, single_answers, unexplained_probability
from rock2d.diagnosis.cause_sets import Search
from rock2d.diagnosis.data import Residuals
from rock2d.diagnosis.evidence import (
    EFFECT_FORM_SHARE,
    FORM_SHARE,
    SPLIT_Z,
    Evidence,
    beside_better_rivals,
    beside_twin,
    beyond_other_law,
)
from rock2d.diagnosis.fitting import fit
from rock2d.diagnosis.levers import FLIGHT, LAW, PROFILE
from rock2d.diagnosis.likelihood import flight_weight
from rock2d.diagnosis.linear_model import LinearModel
from rock2d.diagnosis.model import Model, to_scale
from rock2d.diagnosis.significance import Gain, chance_p_value, outside_probability, probability_from_p_value
from rock2d.diagnosis.visibility import (
    is_negligible,
    is_out_of_range,
    lost_in_first_flights,
    only_gravity_is_turned,
    p_of_size,
    relative_size,
)
from rock2d.effects import catalogue
from rock2d.scene.cross_section import CrossSection
from tests.effects.worlds import FLOOR, with_effect, world
from tests.kinematics import synthetic_films
from tests.laboratory import SETUP

RELEASES = 40
EFFECTS = ("adhesion", "air_drag", "frame_rate_error", "scale_error")


def gain(total, spread=0.0):
    """A gain over RELEASES releases with a total, and a spread between them."""
    signs = np.resize([1.0, -1.0], RELEASES)
    return Gain(np.full(RELEASES, total / RELEASES) + spread * signs)


def found(own_gain=50.0, replacement_gain=0.0, chance=1e-6, left_by_forms=0.0, **rival_z):
    return Evidence(gain(own_gain), gain(replacement_gain), left_by_forms, chance, rival_z)


def test_a_gain_that_chance_exceeds_in_one_film_of_a_hundred_is_as_probable_as_not():
    assert probability_from_p_value(0.01) == pytest.approx(0.5, abs=0.01)
    assert probability_from_p_value(0.3) < 0.12 and probability_from_p_value(1e-5) > 0.99


def test_the_tail_of_chance_is_exponential_beyond_its_draws():
    """Exponential gains: the share that exceeds x is exp(-x), also where no draw reaches."""
    draws = -np.log1p(-(np.arange(100) + 0.5) / 100)
    for x in (0.5, 1.0, 2.0):
        assert chance_p_value(x, draws) == pytest.approx(np.exp(-x), abs=0.02)
    assert chance_p_value(9.0, draws) == pytest.approx(np.exp(-9.0), rel=0.3)


@pytest.mark.parametrize(("ratio", "named"), [(2.0, True), (0.8, True), (0.35, False), (0.1, False)])
def test_what_is_learnt_in_its_place_must_not_explain_much_more(ratio, named):
    assert found(own_gain=100.0 * ratio, replacement_gain=100.0).named("adhesion") == named


def test_what_blocks_at_rest_show_is_no_imitation_of_a_law():
    """A curve over the state before an impact may imitate an offset of the angle, but no block lies otherwise by it."""
    imitator = found(own_gain=50.0, replacement_gain=100.0)
    assert not imitator.named("angle_offset") and not replace(imitator, rests_z=2.0).named("angle_offset")
    assert replace(imitator, rests_z=4.0).p > 0.9
    assert replace(imitator, rests_z=-4.0).p == imitator.p


@pytest.mark.parametrize(("own_gain", "named"), [(40.0, False), (150.0, False), (450.0, True)])
def test_a_law_of_the_same_force_may_only_correct_the_form_of_the_other(own_gain, named):
    """A drag with the exponent 1.7 gains with a quadratic law, and a little more with a linear one beside it."""
    beside = beyond_other_law(found(own_gain, left_by_forms=1.0), other_gain=1000.0)
    assert beside.named("flight_damping") == named
    assert found(own_gain, left_by_forms=1.0).named("flight_damping")


def test_the_stricter_of_two_limits_holds():
    strict = found(50.0, left_by_forms=100.0)
    assert beyond_other_law(strict, other_gain=100.0) == strict


def test_twins_that_cannot_be_told_apart_share_one_name():
    own = found(scale_error=0.0)
    shares = own.probabilities("frame_rate_error")
    assert shares["frame_rate_error"] == pytest.approx(shares["scale_error"]) == pytest.approx(own.p / 2)
    assert own.named("frame_rate_error") and own.group == ["scale_error"]


def test_one_of_many_is_no_name():
    own = Evidence(gain(50.0), gain(0.0), 0.0, 1e-6, {f"effect {i}": 0.1 * i for i in range(9)})
    assert not own.named("adhesion") and len(own.group) == 2
    answers = single_answers({"adhesion": own}, 0.03, EFFECTS)
    assert max(answers, key=lambda name: answers[name]) == "unknown"


def test_the_largest_cause_is_the_first_answer_and_all_sum_to_one():
    evidence = {"adhesion": found(own_gain=20.0), "air_drag": found(own_gain=200.0, chance=1e-4)}
    answers = single_answers(evidence, 0.03, EFFECTS)
    assert sum(answers.values()) == pytest.approx(1.0)
    assert answers["air_drag"] > 0.9 and answers["adhesion"] < 0.1
    assert inclusion_probabilities(evidence)["adhesion"] > 0.9
    nothing = single_answers({}, 0.03, EFFECTS)
    assert nothing["none"] > 0.9 and sum(nothing.values()) == pytest.approx(1.0)


def test_what_is_learnt_is_outside_the_catalogue_if_it_is_more_than_the_form_of_a_law_leaves():
    clear, scattered = gain(100.0, spread=1.0), gain(100.0, spread=30.0)
    assert outside_probability(clear, 0.0) > 0.95 and outside_probability(clear, 35.0) > 0.9
    assert outside_probability(clear, 2500.0) < 0.1
    assert outside_probability(scattered, 0.0) < 0.5 and outside_probability(gain(0.0), 0.0) < 0.05


@pytest.mark.parametrize(("chance", "outside"), [(1e-6, True), (0.4, False)])
def test_what_is_learnt_beside_chance_alone_is_not_outside(monkeypatch, chance, outside):
    """Two models: a member with a learnt change, and nothing at all, which explains nothing. If the member is real,
    the second does not count; if it may be chance, it does."""
    gains = {"base": gain(0.0), "member": gain(20.0, 0.5), "learnt": gain(60.0, 0.5), "nothing": gain(0.0)}
    monkeypatch.setattr(attribution, "gain_left_by_forms", lambda search, cause_set: 0.0)
    monkeypatch.setattr(
        attribution, "held_out_gain", lambda data, one, other: Gain(gains[one].gain - gains[other].gain)
    )
    search = SimpleNamespace(data=None, base="base", best=SimpleNamespace(names=frozenset()))
    models = [
        WeighedSet("nothing", "nothing", "nothing", {}),
        WeighedSet("member", "learnt", "member", {"lens_distortion": found(20.0, chance=chance)}),
    ]
    p = attribution._outside_probability(search, models, [gain(0.0), gain(0.0)])
    assert (p > 0.9) == outside and (p < 0.1) == (not outside)


@pytest.mark.parametrize(
    ("name", "lever", "share"),
    [
        ("ploughing_drag", LAW, FORM_SHARE),
        ("ploughing_drag", FLIGHT, EFFECT_FORM_SHARE),
        ("ploughing_drag", PROFILE, EFFECT_FORM_SHARE),
        ("surface_roughness", LAW, EFFECT_FORM_SHARE),
        ("air_drag", LAW, EFFECT_FORM_SHARE),
        ("lens_distortion", FLIGHT, FORM_SHARE),
    ],
)
def test_what_a_learnt_change_of_impacts_misses_another_effect_of_impacts_may_follow(monkeypatch, name, lever, share):
    """A kick of the spin gained 221 as a curve over the place, and ploughing, which did not act, 52 beside it."""
    monkeypatch.setattr(evidence, "_gain_in", lambda phase, model, reference: 221.0)
    search = SimpleNamespace(best=None, effects=catalogue(), without=lambda best: {})
    left = evidence._left_by_forms(search, SimpleNamespace(changes=[SimpleNamespace(lever=lever)]), name)
    assert left == pytest.approx(share * 221.0)
    assert found(52.0, left_by_forms=left).named(name) == (share == EFFECT_FORM_SHARE)


def test_what_a_small_share_gains_beside_a_large_cause_may_be_the_form_of_its_law():
    assert found(own_gain=300.0, left_by_forms=EFFECT_FORM_SHARE * 3000.0).named("adhesion")
    assert not found(own_gain=80.0, left_by_forms=EFFECT_FORM_SHARE * 3000.0).named("adhesion")


def test_an_effect_whose_place_a_curve_can_take_must_gain_more_than_forms_of_other_laws_leave():
    """A drag of another form than the catalogue's is a damping, and a curve over the velocity, or a second drag."""
    sure, doubted = (found(own_gain=600.0, left_by_forms=share * 3000.0) for share in (EFFECT_FORM_SHARE, FORM_SHARE))
    assert sure.named("air_drag") and not doubted.named("air_drag")
    assert replace(doubted, left_by_forms=FORM_SHARE * 300.0).named("soil_compaction")


def test_a_small_effect_matters_if_its_gain_is_large_but_never_a_small_scatter():
    """A roughness of 0.05° gains in a long film, but it is that of no ground, and closes no gap."""
    for name, size, gain_z, negligible in (
        ("scale_error", 0.003, 21.0, False),
        ("scale_error", 0.003, 12.0, True),  # an image that is slightly off shows in all impacts
        ("geometry_error", 0.003, 12.0, True),
        ("rounded_edges", 0.003, 12.0, False),
        ("rounded_edges", 0.003, 7.0, True),
        ("surface_roughness", 0.003, 21.0, True),
        ("surface_roughness", 0.03, 21.0, False),
    ):
        assert is_negligible(catalogue()[name], [size], gain_z) == negligible


def test_what_is_refused_and_not_negligible_is_unknown():
    """A gain that curves explain better shows that something acts; one of no useful size is none."""
    refused = found(own_gain=100.0, replacement_gain=1000.0)
    answers = single_answers({"adhesion": refused}, 0.03, EFFECTS)
    assert answers["unknown"] > 0.9
    small = replace(refused, negligible=True)
    assert single_answers({"adhesion": small}, 0.03, EFFECTS)["none"] > 0.9


def test_what_acts_and_is_no_effect_lies_outside():
    """A weak member leaves no doubt that it, or nothing, acts; beside a name the form of its law may leave the gain."""
    refused = found(own_gain=100.0, replacement_gain=1000.0)
    assert unexplained_probability({"adhesion": refused}) > 0.9
    assert unexplained_probability({"adhesion": refused, "air_drag": found()}) == 0.0
    weak = found(chance=0.02)
    assert 0.2 < weak.p_acts < 0.5 and unexplained_probability({"adhesion": weak}) < 0.01
    assert unexplained_probability({"adhesion": replace(refused, negligible=True)}) == 0.0


def test_the_place_where_an_effect_acts_is_no_size():
    effect = catalogue()["zone_contrast"]
    model = Model(world(), np.ones(5), [effect])
    own = SimpleNamespace(model=model, p=model.start())
    own.p[model.positions[effect.name]] = [0.1, 0.0, 0.0, 2.0]
    assert 0.0 < relative_size(own, effect.name) < 0.1


def test_a_part_of_a_twin_counts_with_what_it_gains_beside_the_twin():
    """A ground at a wrong height, beside a wrong frame rate, is a part of a wrong scale."""
    beside_scale = {"geometry_error": 20.0, "flight_damping": 600.0, "scale_error": 900.0}
    names = frozenset({"frame_rate_error", "geometry_error", "flight_damping"})
    alone = dict.fromkeys(names, found(own_gain=500.0))
    for lead, weaker in ((1.0, {"geometry_error": 20.0}), (400.0, {})):  # of the frame rate over the scale
        search = SimpleNamespace(
            best=SimpleNamespace(names=names),
            set_of=lambda names: names,
            without=lambda names: {name: name for name in names},
            gain=lambda _, less, lead=lead: gain(beside_scale.get(less, lead), spread=1.0),
        )
        found_beside = beside_twin(search, "frame_rate_error", alone)
        assert {name: own.own_gain.total for name, own in found_beside.items()} == pytest.approx(weaker)
        assert all(own.p_chance > alone[name].p_chance for name, own in found_beside.items())


@pytest.mark.parametrize(("share", "z", "named"), [(2.5, -15.0, False), (1.1, -1.5, True), (0.9, 0.5, True)])
def test_a_member_that_gains_much_less_than_a_refused_rival_imitates(share, z, named):
    """A lens in the place of the drag of the air, which gains 2.5 times as much, but cannot be named."""
    search = SimpleNamespace(
        best=None,
        find_rivals=lambda cause_set, name, least: {"air_drag": z} if z < least else {},
        share_in_place=lambda name, rival: share,
    )
    lens = beside_better_rivals(search, "lens_distortion", found(own_gain=100.0))
    assert lens.named("lens_distortion") == named
    assert not lens.replacement_gain.gain.any()  # a smaller set must not take it for what was learnt


@pytest.mark.parametrize(("beside", "other"), [(20.0, False), (90.0, True)])
def test_a_rival_beside_which_a_member_keeps_its_gain_explains_something_else(beside, other):
    """A drag of the air in the place of a lens, whose gain it takes, and in that of an offset of the angle."""
    best, smaller, both, in_place = (object() for _ in range(4))
    search = SimpleNamespace(
        without=lambda cause_set: {"lens_distortion": smaller},
        _with_each=lambda names, cause_set: [{best: both, smaller: in_place}[cause_set]],
        gain=lambda cause_set, less: {(best, smaller): gain(100.0), (both, in_place): gain(beside)}[cause_set, less],
    )
    assert Search._explains_something_else(search, best, "lens_distortion", "air_drag") == other


@pytest.mark.parametrize(
    ("name", "lever", "share"),
    [
        ("scale_error", FLIGHT, 0.2), ("scale_error", LAW, 0.05), ("camera_tilt", FLIGHT, 0.05),
        ("lens_distortion", FLIGHT, 0.25), ("keystone_distortion", LAW, 0.25),
    ],
)  # fmt: skip
def test_another_gravity_may_be_what_the_form_of_a_learnt_acceleration_misses(name, lever, share, monkeypatch):
    """A pull near the ground, learnt as a smooth function of the height: a fifth of its gain may be left, and a
    twentieth for effects that do not change gravity in flights. A distortion of the picture may follow a quarter of
    what any change misses. What is doubted may follow a quarter, whatever it is."""
    monkeypatch.setattr(evidence, "_gain_in", lambda phase, model, reference: 100.0)
    search = SimpleNamespace(best=None, effects=catalogue(), without=lambda cause_set: {})
    learnt = SimpleNamespace(changes=[SimpleNamespace(lever=lever)])
    assert evidence._left_by_forms(search, learnt, name) == pytest.approx(100.0 * share)
    assert evidence._left_by_forms(search, learnt, name, FORM_SHARE) == pytest.approx(100.0 * FORM_SHARE)


def test_an_aspect_neither_makes_nor_refuses_a_scale():
    effect = catalogue()["scale_error"]
    model = Model(world(), np.ones(5), [effect])
    for scale, negligible, impossible in ((0.95, False, False), (0.85, False, True), (1.0, True, False)):
        own = pulled(
            model, {5: to_scale(model.parameters[0][0], scale), 6: to_scale(model.parameters[0][1], 1.03)}, 5.0
        )
        assert is_negligible(effect, [relative_size(own, effect.name)], 0.0) == negligible
        assert is_out_of_range(own, effect.name) == impossible


def pulled(model, values, z):
    """A fit with `values` at positions of its parameters, each pulled outwards by z standard errors by 400 impacts."""
    p, n = model.start(), 400
    p[list(values)] = list(values.values())
    j = np.zeros((n, 1, model.size))
    j[:, 0, list(values)] = np.sign(p[list(values)])
    # a small residual has the weight 5 / 4 in the robust likelihood; the standard error is 1 / √n
    r = np.full((n, 1), -z / np.sqrt(n) * 4.0 / 5.0)
    flights = np.empty((0, 3, 2))
    jacobian = SimpleNamespace(impacts=j, flights=np.empty((0, 3, 2, model.size)))
    return SimpleNamespace(
        model=model, p=p, p_covariance=np.eye(model.size) / n, residuals=Residuals(r, flights), jacobian=jacobian,
        covariance=lambda: np.ones((n, 1, 1)),
    )  # fmt: skip


@pytest.mark.parametrize("z", [0.5, 2.0, 4.0])
def test_the_p_value_of_a_size_is_that_of_a_normal_error(z):
    """One parameter: twice the normal tail; two: exp(-z²/2). The aim of the camera does not count; a scatter and a
    choice have no p value."""
    for name, own, p_value in (
        ("scale_error", {5: z / 20.0}, 2.0 * ndtr(-z)),
        ("keystone_distortion", {5: 0.6 * z / 20.0, 6: -0.8 * z / 20.0, 7: 1.0, 8: -1.0}, np.exp(-0.5 * z**2)),
        ("surface_roughness", {5: z / 20.0}, 0.0),
        ("mirrored_axis", {5: 1.0}, 0.0),
        ("scale_error", {}, 1.0),
    ):
        fit = pulled(Model(world(), np.ones(5), [catalogue()[name]]), own, 0.0)
        assert p_of_size(fit, name) == pytest.approx(p_value, rel=1e-6)


@pytest.mark.parametrize(("friction", "z", "impossible"), [(0.4, 0.5, False), (0.4, 5.0, True), (0.5, 5.0, False)])
def test_a_value_at_the_end_of_its_range_is_impossible_only_if_data_pull_it_beyond(friction, z, impossible):
    """Friction on an embankment 0.51 of that in the ditch, fitted as 0.40 ± 0.06, where the range ends. The
    contrast of zones, which gains 450, had been refused."""
    model = Model(world(), np.ones(5), [catalogue()["zone_contrast"]])
    stiffness, _, tan_phi, _ = model.parameters[0]
    fit = pulled(model, {5: to_scale(stiffness, 3.9), 7: to_scale(tan_phi, friction)}, z)
    assert is_out_of_range(fit, "zone_contrast") == impossible


def test_a_scatter_at_the_end_of_its_range_is_impossible():
    """Residuals do not pull it: it changes only their covariance."""
    model = Model(world(), np.ones(5), [catalogue()["surface_roughness"]])
    assert is_out_of_range(pulled(model, {5: 2.0}, 0.0), "surface_roughness")
    assert not is_out_of_range(pulled(model, {5: 1.0}, 0.0), "surface_roughness")


@pytest.mark.parametrize(
    "ground_rad, ground, cancels", [(-0.02, FLOOR, True), (-0.01, FLOOR, False), (-0.02, SETUP, False)]
)
def test_turns_of_camera_and_ground_that_cancel_turn_only_gravity(ground_rad, ground, cancels):
    """The ground then lies in the picture as stated, as if a steady force acted along x. An embankment shows it."""
    values = {"camera_tilt": [0.02, 0.0, 0.0], "geometry_error": [ground_rad, 0.0]}
    model = Model(stated := world(ground), np.ones(5), [catalogue()[name] for name in values])
    p = model.start()
    for name, own in values.items():
        p[model.positions[name].start] = to_scale(model.parameters_of(name)[0], own[0])
    assert only_gravity_is_turned(SimpleNamespace(model=model, p=p)) == cancels
    built = with_effect(
        with_effect(stated, "geometry_error", values["geometry_error"]), "camera_tilt", values["camera_tilt"]
    )
    picture = built.view.record(np.column_stack([built.cross_section.points_m, np.zeros(len(ground.points_m))]))[:, :2]
    angle = [np.arctan2(*(points[-1] - points[0])[::-1]) for points in (picture, ground.points_m)]
    assert (abs(angle[0] - angle[1]) < 1e-9) == cancels


@pytest.mark.parametrize(("name", "values"), [("scale_error", [0.9, 1.0, 0.0, 0.0]), ("frame_rate_error", [1.1])])
@pytest.mark.parametrize("recorded", [True, False])
def test_a_wrong_scale_or_rate_is_in_first_flights_too(name, values, recorded):
    """Later flights may show it without: what acts near the ground looks like another gravity there."""
    true = synthetic_films.with_causes(synthetic_films.world(), {name: values} if recorded else {})
    setup, data = synthetic_films.data_of(synthetic_films.film(true, releases=12))
    model = Model(setup, synthetic_films.START, [catalogue()[name]])
    p = model.start()
    p[model.positions[name].start] = to_scale(model.parameters_of(name)[0], values[0])
    fitted = SimpleNamespace(model=model, p=p, residuals=model.residuals(p, data))
    lost = lost_in_first_flights(fitted, data, name)
    assert (lost > 0.0) != recorded
    if not recorded:  # what the best share of the change would gain there
        first = np.append(data.flights.follows < 0, np.zeros(len(data.flight_release) - data.flown, bool))
        r = fitted.residuals.flights[first]
        change, weight = model.residuals(model.start(), data).flights[first] - r, flight_weight(r)
        best = minimize_scalar(lambda less: 0.5 * float((weight * (r + less * change) ** 2).sum()))
        assert lost == pytest.approx(0.5 * float((weight * r**2).sum()) - best.fun, rel=1e-6)


@pytest.mark.parametrize("camera", [True, False])
def test_a_camera_changes_flights_and_impacts_alike(camera):
    """A tilted camera does. A set-up that was surveyed in the turned picture does not: the ground is then where it was
    stated, and only gravity is turned."""
    tilt_rad = 0.03
    true = synthetic_films.with_causes(synthetic_films.world(), {"camera_tilt": [tilt_rad, 0.0, 0.0]})
    film = synthetic_films.film(true, releases=12)
    if not camera:
        points = film.cross_section.points_m
        picture = true.view.record(np.column_stack([points, np.zeros(len(points))]))[:, :2]
        film = replace(film, cross_section=CrossSection(picture, film.cross_section.zones))
    setup, data = synthetic_films.data_of(film)
    model = Model(setup, synthetic_films.START, [catalogue()["camera_tilt"]])
    start = model.start()
    start[model.positions["camera_tilt"].start] = to_scale(model.parameters_of("camera_tilt")[0], 0.5 * tilt_rad)
    fitted = fit(model, data, start)
    apart = LinearModel(fitted, data).gain_of_own_values_in_flights("camera_tilt")
    assert (apart.significance > SPLIT_Z) != camera
