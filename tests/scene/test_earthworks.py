"""Embankments and ditches that are given by their sizes have these sizes."""

import numpy as np
import pytest

from rock2d.scene.cross_section import CrossSection, CrossSectionError, embankment_facets
from rock2d.scene.earthworks import (
    DitchSizes,
    EarthworkError,
    EmbankmentSizes,
    number_of_line,
    with_earthworks,
    with_numbered_earthworks,
)

SLOPE = CrossSection([[0, 50], [60, 10], [100, 6], [160, 6]], ["scree", "meadow", "valley"])


def sizes(**changed) -> EmbankmentSizes:
    return EmbankmentSizes(
        **{"x_m": 80.0, "height_m": 4.0, "crest_m": 3.0, "uphill_deg": 60.0, "downhill_deg": 34.0} | changed
    )


def facets(ground: CrossSection, zone: str) -> np.ndarray:
    """(n, 2) edges of the facets of a zone."""
    return np.diff(ground.points_m, axis=0)[np.array(ground.zones) == zone]


@pytest.mark.parametrize("uphill", [35.0, 60.0, 90.0])
def test_an_embankment_has_its_sizes_and_the_rest_is_the_natural_ground(uphill):
    ground = with_earthworks(SLOPE, sizes(uphill_deg=uphill))
    ((dx, dy),) = facets(ground, "uphill_face")
    assert np.degrees(np.arctan2(dy, dx)) == pytest.approx(uphill) and dy == pytest.approx(4.0)
    assert facets(ground, "crest").tolist() == [pytest.approx([3.0, 0.0])]
    ((dx, dy),) = facets(ground, "downhill_face")
    assert np.degrees(np.arctan2(-dy, dx)) == pytest.approx(34.0)
    start = ground.points_m[ground.zones.index("uphill_face")]
    assert start == pytest.approx([80.0, 8.0])  # 4 m of fall on 40 m of meadow
    end = ground.points_m[ground.zones.index("downhill_face") + 1]
    assert end[1] == pytest.approx(SLOPE.height_m(end[:1])[0])
    x = np.r_[np.linspace(0, 79.99, 30), np.linspace(end[0], 160, 30)]
    assert ground.height_m(x) == pytest.approx(SLOPE.height_m(x))
    assert ground.zones == ("scree", "meadow", "uphill_face", "crest", "downhill_face", "meadow", "valley")


def test_a_ditch_has_its_sizes_and_the_facing_goes_down_to_its_bottom():
    ground = with_earthworks(SLOPE, sizes(), DitchSizes(5.0, 1.5, 45.0))
    wall, bottom = facets(ground, "ditch")
    assert np.degrees(np.arctan2(-wall[1], wall[0])) == pytest.approx(45.0)
    assert bottom.tolist() == pytest.approx([5.0, 0.0])
    ((dx, dy),) = facets(ground, "uphill_face")
    assert dy == pytest.approx(5.5) and np.degrees(np.arctan2(dy, dx)) == pytest.approx(60.0)
    corner = ground.points_m[ground.zones.index("uphill_face")]
    assert corner == pytest.approx([80.0 - 1.5 / np.tan(np.deg2rad(60.0)), 8.0 - 1.5])
    assert np.isclose(ground.height_m(np.array([80.0 + 4.0 / np.tan(np.deg2rad(60.0))])), 12.0).all()


def test_a_level_ditch_without_depth_is_cut_into_the_slope():
    ground = with_earthworks(SLOPE, sizes(x_m=50.0), DitchSizes(6.0, 0.0, 70.0))
    wall, bottom = facets(ground, "ditch")
    assert bottom.tolist() == pytest.approx([6.0, 0.0]) and wall[1] < -4.0
    removed = SLOPE.height_m(np.linspace(44, 50, 20)) - ground.height_m(np.linspace(44, 50, 20))
    assert (removed > -1e-9).all() and removed.max() > 3.0


def test_a_ditch_without_depth_on_level_ground_has_no_wall():
    ground = with_earthworks(SLOPE, sizes(x_m=130.0), DitchSizes(6.0, 0.0, 70.0))
    assert facets(ground, "ditch").tolist() == [pytest.approx([6.0, 0.0])]


def test_measure_lines_rise_from_the_facing_and_the_crest():
    ground = with_earthworks(SLOPE, sizes())
    run = 4.0 / np.tan(np.deg2rad(60.0))
    for name, share in (("facing_1_3", 1 / 3), ("facing_2_3", 2 / 3), ("crest", 1.0)):
        low, high = ground.measure_lines[name]
        assert low == pytest.approx([80.0 + share * run, 8.0 + share * 4.0])
        assert high[0] == low[0] and high[1] > ground.points_m[:, 1].max()
    assert list(with_earthworks(SLOPE, sizes(uphill_deg=90.0)).measure_lines) == ["arrival", "crest"]


def test_the_arrival_line_rises_from_the_natural_ground_before_the_earthworks():
    low, high = with_earthworks(SLOPE, sizes()).measure_lines["arrival"]
    assert low == pytest.approx([76.0, SLOPE.height_m(np.array([76.0]))[0]])
    assert high[0] == low[0]
    ground = with_earthworks(SLOPE, sizes(), DitchSizes(6.0, 1.0, 45.0))
    first = ground.points_m[list(ground.zones).index("ditch")]
    assert ground.measure_lines["arrival"][0] == pytest.approx(first)


def test_a_crest_inside_the_ground_is_refused():
    valley = CrossSection([[0, 20], [20, 0], [40, 0], [60, 20]], ["a", "b", "c"])
    with pytest.raises(EarthworkError, match="inside the ground"):
        with_earthworks(valley, sizes(x_m=38.0, crest_m=10.0))


def test_a_measure_line_of_the_same_name_is_refused():
    ground = CrossSection(SLOPE.points_m, SLOPE.zones, {"crest": [[70, 9], [70, 40]]})
    with pytest.raises(CrossSectionError, match="crest"):
        with_earthworks(ground, sizes())


# several --------------------------------------------------------------------------------------------------------

DITCH = DitchSizes(4.0, 0.5, 45.0)


def two(**second) -> dict:
    return {1: (sizes(), DITCH), 2: (sizes(**{"x_m": 110.0, "height_m": 3.0} | second), None)}


def test_several_embankments_carry_their_numbers_from_uphill_to_downhill():
    ground = with_numbered_earthworks(SLOPE, two())
    assert [zone for zone in ground.zone_names if zone[-1].isdecimal()] == [
        "ditch_1", "uphill_face_1", "crest_1", "downhill_face_1", "uphill_face_2", "crest_2", "downhill_face_2",
    ]  # fmt: skip
    assert list(ground.measure_lines) == [
        f"{line}_{number}" for number in (1, 2) for line in ("arrival", "crest", "facing_1_3", "facing_2_3")
    ]
    first, second = ground.embankments
    assert ground.points_m[second.left] == pytest.approx([110.0, 6.0]) and second.height_m == pytest.approx(3.0)
    assert ground.zones[first.left : first.right] == ("uphill_face_1", "crest_1", "downhill_face_1")
    assert first.crest_end == first.crest + 1 and first.right < second.left
    named = np.array(ground.zones)[embankment_facets(ground)]
    assert {zone[-1] for zone in named} == {"1", "2"} and len(named) == 6


def test_uphill_of_a_further_embankment_nothing_changes():
    alone = with_numbered_earthworks(SLOPE, {1: two()[1]})
    both = with_numbered_earthworks(SLOPE, two())
    plain = with_earthworks(SLOPE, sizes(), DITCH)
    assert (alone.points_m == plain.points_m).all()
    end = both.embankments[0].right + 1
    assert (both.points_m[:end] == alone.points_m[:end]).all() and both.zones[: end - 1] == alone.zones[: end - 1]
    for name, ends in alone.measure_lines.items():
        assert (both.measure_lines[name] == ends).all()


def test_the_arrival_line_of_a_near_embankment_stands_behind_the_one_before():
    end = with_earthworks(SLOPE, sizes(), DITCH)
    back = end.points_m[end.embankments[0].right, 0]
    near = with_numbered_earthworks(SLOPE, two(x_m=back + 1.0))
    assert near.measure_lines["arrival_2"][0, 0] == back
    touching = with_numbered_earthworks(SLOPE, two(x_m=back))
    assert touching.embankments[0].right == touching.embankments[1].left


def test_measure_lines_know_their_embankment():
    known = {"crest_2": 2, "facing_1_3_2": 2, "arrival_12": 12, "crest": None, "facing_1_3": None, "forest_2": None}
    assert {name: number_of_line(name) for name in known} == known
