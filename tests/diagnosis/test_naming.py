"""Which members of the best set stay: rivals that do better come in, what cannot be named leaves."""

from collections.abc import Collection, Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rock2d.diagnosis import attribution
from rock2d.diagnosis.diagnosis_content import film_sentences
from rock2d.diagnosis.evidence import Evidence
from rock2d.diagnosis.significance import Gain
from rock2d.diagnosis.workload import DiagnosisBars

SURE, NEVER = 1e-6, 1.0  # probability of the gain by chance
GAINS = {"camera_tilt": 50.0, "scale_error": 40.0, "frame_rate_error": 35.0, "adhesion": 30.0, "air_drag": 20.0}


class Sets:
    """Stands for a search: a set is its names. A set that replaces another one gains `confirmed` in each release."""

    def __init__(self, *names: str, confirmed: float, promising: Collection[str] = ()) -> None:
        self.confirmed, self.promising = confirmed, promising
        self.best, self.effects = self.set_of(frozenset(names)), GAINS
        self.data, self.bars = None, DiagnosisBars(False, len(GAINS), 1)
        self.weighed: list[set[str]] = []

    def set_of(self, names: frozenset[str]) -> Any:
        return SimpleNamespace(names=names, fit=None, held_out=None)

    def without(self, cause_set: Any) -> dict[str, Any]:
        return {name: self.set_of(cause_set.names - {name}) for name in sorted(cause_set.names)}

    def promising_additions(self, cause_set: Any, excluded: frozenset[str], most: int) -> list[Any]:
        return [self.set_of(cause_set.names | {name}) for name in self.promising if name not in excluded][:most]

    def gain(self, cause_set: Any, other: Any) -> Gain:
        return Gain(self.confirmed + np.linspace(-0.1, 0.1, 10))


def member(name: str, chance: float, ahead: Mapping[str, float] | None = None) -> Evidence:
    return Evidence(Gain(np.full(10, GAINS[name] / 10)), Gain(np.zeros(10)), 0.0, chance, ahead or {})


@pytest.fixture
def stay(monkeypatch: pytest.MonkeyPatch) -> Any:
    """(evidence of a member in a set, members at first) -> members at last, and the sets that were weighed."""

    def of(
        judged: Any, *names: str, confirmed: float = 1.0, promising: Collection[str] = ()
    ) -> tuple[set[str], list[set[str]]]:
        search = Sets(*names, confirmed=confirmed, promising=promising)

        def evidence_of_members(own: Any, *_: Any) -> dict[str, Evidence]:
            search.weighed.append(set(own.best.names))
            return {name: judged(name, own.best.names) for name in own.best.names}

        def rivals(own: Any, name: str, gain: Gain) -> Mapping[str, float]:
            return judged(name, own.best.names).rival_z

        monkeypatch.setattr(attribution, "evidence_of_members", evidence_of_members)
        monkeypatch.setattr(attribution, "plausible_rivals", rivals)
        monkeypatch.setattr(attribution, "learn", lambda best, data: SimpleNamespace(changes=[]))
        attribution._evidence_of_sets(search)  # type: ignore[arg-type]
        return set(search.best.names), search.weighed

    return of


def test_a_rival_that_is_refused_gives_the_place_back(stay):
    def judged(name, names):
        if name == "scale_error":
            return member(name, SURE, {"camera_tilt": -3.0})
        return member(name, NEVER if name == "camera_tilt" else SURE)

    members, weighed = stay(judged, "scale_error", "adhesion")
    assert members == {"scale_error", "adhesion"}
    assert weighed[:2] == [{"camera_tilt", "adhesion"}, {"scale_error", "adhesion"}]


def test_a_rival_that_its_fit_does_not_confirm_does_not_come_in(stay):
    """Screening expects too much of it."""

    def judged(name, names):
        return member(name, SURE, {"camera_tilt": -3.0} if name == "scale_error" else None)

    assert stay(judged, "scale_error", confirmed=-1.0) == ({"scale_error"}, [{"scale_error"}])


def test_a_refused_member_gives_way_to_its_better_rival_before_it_is_lost(stay):
    def judged(name, names):
        return member("air_drag", NEVER, {"scale_error": -2.0}) if name == "air_drag" else member(name, SURE)

    assert stay(judged, "air_drag", "adhesion")[0] == {"scale_error", "adhesion"}


def test_refused_members_leave_before_the_one_among_them_that_gains_most(stay):
    """The others may be what made it doubtful."""

    def judged(name, names):
        return member(name, SURE if names == {"camera_tilt"} else NEVER)

    assert stay(judged, "camera_tilt", "adhesion", "air_drag")[0] == {"camera_tilt"}


def test_a_member_that_others_hid_comes_back(stay):
    """Beside two imitators a true cause gains nothing; they are refused, too, and leave after it."""

    def judged(name, names):
        return member(name, NEVER if names & {"scale_error", "camera_tilt"} else SURE)

    members, weighed = stay(judged, "air_drag", "scale_error", "camera_tilt")
    assert members == {"air_drag"} and {"air_drag"} in weighed


def test_an_effect_that_the_search_passed_by_for_a_refused_one_is_weighed(stay):
    """The search took a tilt that is none, and found no room for adhesion beside it."""

    def judged(name, names):
        return member(name, NEVER if name == "camera_tilt" else SURE)

    members, weighed = stay(judged, "air_drag", "camera_tilt", promising=["camera_tilt", "adhesion"])
    assert members == {"air_drag", "adhesion"} and {"air_drag", "adhesion"} in weighed


def test_effects_that_gain_beside_a_cause_end_with_the_first_that_is_refused(stay):
    """Something outside the catalogue lets many effects gain; not each of them costs a weighing."""

    def judged(name, names):
        return member(name, SURE if name == "air_drag" else NEVER)

    members, weighed = stay(judged, "air_drag", promising=["adhesion", "camera_tilt", "scale_error"])
    assert members == {"air_drag"} and weighed == [{"air_drag"}, {"air_drag", "adhesion"}]


def test_a_member_that_makes_all_others_doubtful_leaves_and_they_stay(stay):
    """All others are sure without it, and doubtful beside it. Adhesion left with it, and comes back."""

    def judged(name, names):
        return member(name, NEVER if "air_drag" in names else SURE)

    members, weighed = stay(judged, "air_drag", "scale_error", "camera_tilt", "adhesion")
    assert members == {"scale_error", "camera_tilt", "adhesion"}
    assert len(weighed) == len(set(map(frozenset, weighed)))


def test_rivals_that_are_each_better_than_the_other_come_to_an_end(stay):
    other = {"camera_tilt": "scale_error", "scale_error": "camera_tilt"}

    def judged(name, names):
        return member(name, SURE, {other[name]: -5.0})

    members, weighed = stay(judged, "camera_tilt")
    assert len(members) == 1 and len(weighed) == 1


def test_a_twin_of_a_member_takes_a_place_as_any_other_rival(stay):
    """A scale error and a frame rate error are one change in flights; contacts may need both."""

    def judged(name, names):
        return member(name, SURE, {"frame_rate_error": -3.0} if name == "camera_tilt" else None)

    assert stay(judged, "camera_tilt", "scale_error")[0] == {"frame_rate_error", "scale_error"}


def test_nothing_stays_where_all_is_chance(stay):
    assert stay(lambda name, names: member(name, NEVER), "camera_tilt", "adhesion", "air_drag")[0] == set()


def test_a_member_of_impossible_size_gives_way_to_a_rival_that_does_as_well(stay):
    """An image that is moved is a scale error of no size, or a ground at another height."""

    def judged(name, names):
        if name == "scale_error":
            return replace(member(name, SURE, {"camera_tilt": 0.2}), negligible=True)
        return member(name, SURE)

    members, weighed = stay(judged, "scale_error", "adhesion")
    assert members == {"camera_tilt", "adhesion"}
    assert weighed[:2] == [{"scale_error", "adhesion"}, {"camera_tilt", "adhesion"}]


def test_a_negligible_member_does_not_give_way_to_a_rival_that_explains_less(stay):
    """A scale that is 0.3 % wrong is no lens that gains half of it."""

    def judged(name, names):
        if name == "scale_error":
            return replace(member(name, SURE, {"camera_tilt": 1.0}), negligible=True)
        return member(name, SURE)

    assert stay(judged, "scale_error", "adhesion")[0] == {"adhesion"}


def test_gravity_is_explained_by_what_is_named_and_doubtful_effects_are_called_so():
    film = SimpleNamespace(off=True, turned=False, sentences=lambda: ["g is off"])
    found = SimpleNamespace(
        named={"air_drag"}, uncertain=["frame_rate_error", "adhesion"], group=lambda name: [],
        learnt=SimpleNamespace(changes=[]),
    )  # fmt: skip
    *_, said = film_sentences(SimpleNamespace(film=film, found=found))
    assert said.endswith("explains gravity in the flights by air_drag, frame_rate_error (not certain)")
    found.named, found.uncertain = {"adhesion"}, []
    *_, said = film_sentences(SimpleNamespace(film=film, found=found))
    assert said.endswith("finds nothing that explains gravity in the flights")
    found.named = {"scale_error"}
    assert film_sentences(SimpleNamespace(film=film, found=found)) == ["g is off"]
