"""Profiles from tables, drawings and terrain models, and the scenarios that start from them."""

import re
import shlex
import warnings

import numpy as np
import pandas as pd
import pytest

from rock2d.commands.profile import ProfileOptions, write_profile
from rock2d.errors import InputError
from rock2d.files.scenario import Scenario
from rock2d.files.scenario_reading import load_scenario
from rock2d.files.surveys.profile import checked_profile, simplified
from rock2d.files.surveys.release_area import release_area
from rock2d.files.surveys.table import read_table
from rock2d.runs.run import run
from tests.programs import refusal

POINTS = np.array([[0, 40], [20, 25], [50, 4], [80, 0]], float)
PLAIN = "0,40\n80,0\n"  # the table of one straight slope


@pytest.mark.parametrize(
    "text",
    [
        "0,40\n20,25\n50,4\n80,0\n",
        "# a survey\nstation;height\n0;40\n20;25\n50;4\n80;0\n",
        "id\tx\ty\n1\t0\t40\n2\t20\t25\n3\t50\t4\n4\t80\t0\n",
        "0 40\n20   25\n50 4\n80 0",
        "x_m,y_m\n80,0\n50,4\n20,25\n0,40\n",  # right to left
        "x,z\n0,0\n30,4\n60,25\n80,40\n",  # rising to the right
        "x,y,z\n100,200,40\n112,216,25\n130,240,4\n148,264,0\n",  # on a map: 20, 30 and 30 m of way
        "distance,elevation\n500,40\n520,25\n520,25\n550,4\n580,0\n",  # a station that is not 0, a point twice
        "Nr;Station [m];Height (m)\n1;0;40\n2;20;25\n3;50;4\n4;80;0\n",
    ],
)
def test_a_table_is_read_however_it_is_written(put, text):
    assert read_table(put(text)).points_m == pytest.approx(POINTS)


@pytest.mark.parametrize(
    ("text", "said", "line"),
    [
        ("", "empty", 1),
        ("0,40\n20,abc\n", "expected numbers", 2),
        ("0;40\n20;25,5\n", "decimal points, not commas", 2),
        ("0,5;40,0\n20,0;25,5\n", "decimal points, not commas", 1),
        ("a,b\n0,40\n", "expected columns of station and height", 1),
        ("0,40\n20\n", "expected 2 columns", 2),
        ("0,92\n25,62,5\n", "decimal points, not commas", 2),
        ("station,height\n8,00,90,00\n", "decimal points, not commas", 2),
        ("0,40\n", "expected 2 to", None),
        ("0,40\n20,nan\n", "expected numbers", 2),
        ("1,0,40\n2,20,25\n", "3 columns without names", 1),
        ("station [mm],height [mm]\n0,40\n80,0\n", "expected metres", 1),
    ],
)
def test_a_table_with_a_mistake_is_refused_with_its_line(put, text, said, line):
    assert refusal(read_table, put(text), said=said).line == line


def test_an_overhang_is_told_by_its_station():
    """80 in place of 8: the next station goes back. A profile that is mirrored tells the stations of the survey."""
    falling = checked_profile(np.array([[0.0, 92.0], [80.0, 90.0], [10.0, 78.0], [125.0, 62.0]]), "it")
    rising = checked_profile(np.array([[0.0, 62.0], [115.0, 78.0], [45.0, 90.0], [125.0, 92.0]]), "it")
    assert "overhangs after the station 80:" in falling.remarks[-1]
    assert "overhangs after the station 45:" in rising.remarks[-1]


def test_what_was_changed_is_said():
    profile = checked_profile(np.array([[5.0, 0.0], [5.0, 0.0], [9.0, 3.0]]), "it")
    assert profile.points_m.tolist() == [[0.0, 3.0], [4.0, 0.0]]
    assert profile.remarks == (
        "1 repeated points left out",
        "mirrored, so that it falls to the right: x = 9 m - station",
    )


def test_simplification_keeps_to_its_tolerance():
    x = np.linspace(0, 100, 401)
    rough = np.random.default_rng(1).normal(0, 0.05, len(x))
    full = checked_profile(np.column_stack([x, 50 - 0.5 * x + 2 * np.sin(x / 15) + rough]), "it")
    few = simplified(full, 0.3)
    assert len(few.points_m) < 60 and f"401 points simplified to {len(few.points_m)}" in few.remarks[-1]
    off = np.interp(x, *few.points_m.T) - full.points_m[:, 1]
    assert np.abs(off).max() < 0.3 * np.hypot(1, 1)  # the tolerance is across the surface


def profile_of(survey, **options) -> np.ndarray:
    """Points of the profile of a survey, whose scenario is written beside it."""
    out = survey.parent / "s.yaml"
    return write_profile(survey, out, ProfileOptions(**options), overwrite=True, report=str).points_m


def scenario_of(folder, survey: str, zones: str = "", name: str = "s.yaml", **options) -> tuple[Scenario, list[str]]:
    """The scenario that is written for the tables of a survey and of its zones, and the lines that are said."""
    (folder / "p.csv").write_text(survey)
    if zones:
        (folder / "zones.csv").write_text(zones)
        options["zones"] = folder / "zones.csv"
    lines: list[str] = []
    write_profile(folder / "p.csv", folder / name, ProfileOptions(**options), report=lines.append)
    return load_scenario(folder / name), lines


def rows_of(points) -> str:
    """Stations and heights as a table."""
    return "\n".join(f"{x},{y}" for x, y in points)


@pytest.mark.parametrize("own", ["site.yaml", "site.png"])
def test_neither_a_scenario_nor_a_picture_is_replaced_unasked(tmp_path, own):
    (tmp_path / "p.csv").write_text("0,10\n9,0\n")
    (tmp_path / own).write_text("mine")
    with pytest.raises(InputError, match=f"{own}: exists; --overwrite"):
        write_profile(tmp_path / "p.csv", tmp_path / "site.yaml")
    assert (tmp_path / own).read_text() == "mine" and len(list(tmp_path.iterdir())) == 2


def test_the_longest_polyline_of_a_drawing_is_read(tmp_path):
    ezdxf = pytest.importorskip("ezdxf")
    drawing = ezdxf.new()
    space = drawing.modelspace()
    space.add_lwpolyline(POINTS.tolist(), dxfattribs={"layer": "terrain"})
    space.add_line((0, 0), (5, 5), dxfattribs={"layer": "frame"})
    space.add_polyline3d([(0, 0, 9), (3, 4, 2), (3, 14, 1)], dxfattribs={"layer": "axis"})
    drawing.saveas(tmp_path / "p.dxf")

    def profile(**options):
        return profile_of(tmp_path / "p.dxf", **options)

    assert profile() == pytest.approx(POINTS)
    assert profile(layer="axis") == pytest.approx(np.array([[0, 9], [5, 2], [15, 1]]))
    with pytest.raises(InputError, match="no polyline on layer 'road'; layers with lines: axis, frame, terrain"):
        profile(layer="road")
    (tmp_path / "p.dxf").write_text("no drawing")
    with pytest.raises(InputError, match="no DXF drawing"):
        profile()


def test_layers_whose_longest_lines_have_the_same_length_are_refused_unless_one_is_chosen(tmp_path):
    ezdxf = pytest.importorskip("ezdxf")
    drawing = ezdxf.new()
    for layer, level in (("survey", 0.0), ("design", 1.0)):
        points = POINTS + np.array([0.0, level])
        drawing.modelspace().add_lwpolyline(points.tolist(), dxfattribs={"layer": layer})
    drawing.saveas(tmp_path / "p.dxf")
    refusal(profile_of, tmp_path / "p.dxf", said="the layers design, survey have the same length: choose one")
    assert profile_of(tmp_path / "p.dxf", layer="survey") == pytest.approx(POINTS)


@pytest.mark.parametrize(("unit", "said"), [(2, "Feet"), (4, "Millimeters"), (0, None), (6, None)])
def test_a_drawing_in_another_unit_than_metres_is_refused(tmp_path, unit, said):
    ezdxf = pytest.importorskip("ezdxf")
    drawing = ezdxf.new(units=unit)
    drawing.modelspace().add_lwpolyline(POINTS.tolist())
    drawing.saveas(tmp_path / "p.dxf")
    if said is None:
        assert profile_of(tmp_path / "p.dxf") == pytest.approx(POINTS)
    else:
        refusal(profile_of, tmp_path / "p.dxf", said=f"the unit of the drawing is {said} .* expected metres")


def grid(folder, kind: str, crs: str = "EPSG:2056"):
    """A plane that falls by 1 in 2 to the north-east of a corner at (1000, 2000), 5 m cells."""
    rasterio = pytest.importorskip("rasterio")
    x, y = 1000 + 5 * (np.arange(40) + 0.5), 2000 + 5 * (np.arange(30) + 0.5)
    heights = 300 - 0.4 * (x - 1000)[None, :] - 0.3 * (y - 2000)[:, None]
    path = folder / f"g.{kind}"
    transform = rasterio.Affine(5, 0, 1000, 0, -5, 2150)
    driver = {"tif": "GTiff", "asc": "AAIGrid"}[kind]
    profile = {"driver": "GTiff", "width": 40, "height": 30, "count": 1, "dtype": "float32", "nodata": -9999.0}
    with rasterio.open(folder / "g.tif", "w", transform=transform, crs=crs, **profile) as made:
        made.write(heights[::-1].astype("float32"), 1)
    if driver == "AAIGrid":
        from rasterio.shutil import copy

        copy(folder / "g.tif", path, driver="AAIGrid")
    return path


@pytest.mark.parametrize("kind", ["tif", "asc"])
def test_sections_of_a_terrain_model_are_those_of_the_plane(tmp_path, kind):
    def profile(**options):
        return profile_of(grid(tmp_path, kind), **options)

    along = profile(line=(1010, 2010, 1090, 2070))  # 100 m in the direction of the fall: 50 m
    assert along[-1] == pytest.approx([100, 300 - 0.4 * 90 - 0.3 * 70]) and along[0, 1] == pytest.approx(293)
    fall = profile(start=(1020, 2020))
    slope = np.diff(fall[:, 1]) / np.diff(fall[:, 0])
    assert slope == pytest.approx(np.full(len(slope), -0.5), abs=1e-4)
    with pytest.raises(InputError, match="no height is known at x = 9"):
        profile(line=(900, 2010, 1090, 2070))
    with pytest.raises(InputError, match="needs either"):
        profile()


@pytest.mark.parametrize(
    ("crs", "said"),
    [
        ("EPSG:2226", "the coordinates are in 'US survey foot': expected metres"),
        ("EPSG:2056+6360", "the heights are in 'US survey foot': expected metres"),
    ],
)
def test_a_terrain_model_in_feet_is_refused(tmp_path, crs, said):
    refusal(profile_of, grid(tmp_path, "tif", crs), line=(1010, 2010, 1090, 2070), said=said)


def test_lines_that_meet_make_a_row_and_a_damaged_drawing_is_recovered(tmp_path):
    import ezdxf

    from rock2d.files.surveys.drawing import read_drawing

    document = ezdxf.new()
    for i in (2, 0, 1):  # in no order, one against the others
        ends = [(*POINTS[i], 0), (*POINTS[i + 1], 0)]
        document.modelspace().add_line(*(ends[::-1] if i == 1 else ends))
    document.saveas(tmp_path / "lines.dxf")
    assert read_drawing(tmp_path / "lines.dxf").points_m == pytest.approx(POINTS)
    text = (tmp_path / "lines.dxf").read_text()
    head = text.index("ENTITIES")
    (tmp_path / "damaged.dxf").write_text(text[:head] + text[head:].replace("\nLINE\n  5\n", "\nLINE\n  5\nX", 1))
    found = read_drawing(tmp_path / "damaged.dxf")
    assert "damaged" in found.remarks[0]


def test_a_surface_that_crosses_itself_is_refused_and_nothing_is_written(tmp_path):
    (tmp_path / "loop.csv").write_text("0,10\n10,0\n5,12\n2,1\n20,-3\n")
    with pytest.raises(InputError, match=r"loop\.csv: the cross-section crosses itself"):
        write_profile(tmp_path / "loop.csv", tmp_path / "site.yaml", report=str)
    assert not (tmp_path / "site.yaml").exists()


def test_a_grid_in_degrees_is_projected_and_keeps_heights_and_lengths(tmp_path):
    import rasterio
    from rasterio.transform import from_origin

    from rock2d.files.surveys.terrain import along_line, read_terrain

    cell = 1 / 3600
    longitude = 8.0 + cell * (np.arange(200) + 0.5)
    latitude = 46.05 - cell * (np.arange(180) + 0.5)
    height = 2000.0 + 4.0e3 * (longitude[None, :] - 8.0) + 9.0e3 * (latitude[:, None] - 46.0)
    with rasterio.open(
        tmp_path / "degrees.tif", "w", driver="GTiff", width=200, height=180, count=1, dtype="float32",
        crs="EPSG:4326", transform=from_origin(8.0, 46.05, cell, cell),
    ) as grid:  # fmt: skip
        grid.write(height.astype("float32"), 1)
    terrain = read_terrain(tmp_path / "degrees.tif")
    ends = np.array([[8.01, 46.01], [8.04, 46.04]])
    found = along_line(terrain, *terrain.metric(ends), "grid")
    at_ends = 2000.0 + 4.0e3 * (ends[:, 0] - 8.0) + 9.0e3 * (ends[:, 1] - 46.0)
    assert sorted(found.points_m[[0, -1], 1]) == pytest.approx(sorted(at_ends), abs=0.1)
    # the ellipsoid's metres to a degree at 46.025 degrees north: 77 420 and 111 150
    length = np.hypot(0.03 * 77_420, 0.03 * 111_150)
    assert found.points_m[-1, 0] == pytest.approx(length, rel=2e-3)
    assert "EPSG:32632" in terrain.remarks[0]


def test_a_profile_becomes_a_scenario_that_runs(tmp_path):
    zones, out = "start,end,name\n0,30,rock\n50,80,run_out\n", tmp_path / "my site.yaml"
    scenario, lines = scenario_of(tmp_path, f"x,y\n{rows_of(POINTS)}", zones, out.name)
    ground = scenario.make_cross_section()
    assert scenario.name == "my_site" and ground.zones == ("rock", "rock", "slope", "run_out")
    assert ground.points_m[:, 0].tolist() == [0, 20, 30, 50, 80]
    assert ground.height_m(POINTS[:, 0]) == pytest.approx(POINTS[:, 1])
    stops = run(scenario, releases=20).to_pandas("stops")
    assert (stops["stop"] != "time").all() and stops["runout_m"].median() > 20
    run(scenario, engine="point_mass", releases=5)
    assert out.with_suffix(".png").stat().st_size > 10_000
    assert "4 points, 80 m long, 40 m of height" in lines[0]
    assert "soil by the names of the zones: rock bedrock, slope medium_scree, run_out deep_soil" in lines
    with pytest.raises(InputError, match="exists"):
        write_profile(tmp_path / "p.csv", out)


def test_a_scenario_holds_no_minus_zero(tmp_path):
    scenario_of(tmp_path, "x,y\n0,40\n80,-0.0001\n")
    assert "[80.000, 0.000]" in (text := (tmp_path / "s.yaml").read_text(encoding="utf-8")) and "-0.000" not in text


def test_an_embankment_of_the_survey_is_fill_and_warnings_come_once(tmp_path):
    zones = "slope", "ditch", "uphill_face", "crest", "downhill_face", "run_out", ""
    points = [(0, 40), (40, 10), (45, 10), (48, 14), (52, 14), (60, 9), (90, 8)]
    rows = [f"{x},{y},{zone}" for (x, y), zone in zip(points, zones, strict=True)]
    with warnings.catch_warnings(record=True) as told:
        scenario, _ = scenario_of(tmp_path, "\n".join(["x,y,zone", *rows]))
    soils = scenario.model.soils
    assert {soils[zone] for zone in ("uphill_face", "crest", "downhill_face")} == {"compacted_fill"}
    assert len(told) == len({str(each.message) for each in told}) and not any(
        ".partial" in str(t.message) for t in told
    )


@pytest.mark.parametrize(
    ("table", "said", "line"),
    [
        ("0,30,rock\n20,80,scree\n", "zones overlap: scree begins at 20 m, inside rock, .* 0 to 30 m .line 1", 2),
        ("start,end,name\n30,0,rock\n", "rock ends at 0 m, not beyond its start at 30 m", 2),
        ("0,nan,rock\n", "expected numbers, found 'nan'", 1),
        ("0,30,rock\n500,530,scree\n", "scree, 500 to 530 m, lies beside the survey, .* 0 to 80 m", 2),
        ("0,30\n", "expected start, end and name", 1),
        ("0;30,5;rock\n", "decimal points, not commas", 1),
        ("von,bis,Zone\n0,30,rock\n", "expected the columns start, end and name, found 'von, bis, Zone'", 1),
        ("0,30,default\n", "must not be called default", 1),
        ("0,30,\n", "name of a zone", 1),
        ("start,end,name\n", "names no zone", 1),
        ("start [km],end [km],name\n0,0.04,rock\n", r"column 'start \[km\]': expected metres", 1),
        ("start [m],end (ft),name\n0,40,rock\n", r"column 'end \(ft\)': expected metres", 1),
    ],
)  # fmt: skip
def test_zones_with_a_mistake_are_refused_with_their_line_and_nothing_is_written(tmp_path, table, said, line):
    found = refusal(scenario_of, tmp_path, PLAIN, table, said=said)
    assert found.line == line and found.file == tmp_path / "zones.csv"
    assert not (tmp_path / "s.yaml").exists()


@pytest.mark.parametrize("rising", [False, True])
def test_zones_lie_at_the_stations_of_the_survey_and_gaps_are_told(tmp_path, rising):
    heights = POINTS[::-1, 1] if rising else POINTS[:, 1]
    stations = 500.0 + (80.0 - POINTS[::-1, 0] if rising else POINTS[:, 0])
    foot, cliff = ((500, 530), (550, 580)) if rising else ((550, 580), (500, 530))
    zones = f"name;start;end\nno;{foot[0]};{foot[1]}\nrock wall;{cliff[0]};{cliff[1]}\n"
    survey = rows_of(zip(stations, heights, strict=True))
    scenario, lines = scenario_of(tmp_path, survey, zones, release=cliff)
    assert scenario.make_cross_section().zones == ("rock wall", "rock wall", "slope", "no")  # "no" is a name, too
    x = scenario.incident["default"].above_ground.x_m.uniform
    assert (x.low, x.high) == (0.0, 30.0)
    line = 3 if rising else 2
    assert f"  zones.csv:{line}: no zone from 530 to 550 m; the ground there is zone slope" in lines


@pytest.mark.parametrize(
    ("table", "zones"),
    [
        ("station,height,zone\n0,40,rock\n20,25,rock\n50,4,meadow\n80,0,\n", ("rock", "rock", "meadow")),
        ("x,y,soil,by\n80,0,meadow,me\n50,4,rock,me\n20,25,rock,me\n0,40,,me\n", ("rock", "rock", "meadow")),
        ("x;y;z;zone\n0;0;40;rock\n0;20;25;rock\n0;50;4;rock\n0;80;0;rock\n", ("slope",) * 3),  # on a map
    ],
)
def test_a_column_names_the_zone_up_to_the_next_point_and_columns_that_are_not_read_are_told(tmp_path, table, zones):
    scenario, lines = scenario_of(tmp_path, table)
    assert scenario.make_cross_section().zones == zones
    unread = [line.rpartition(": ")[2] for line in lines if "columns that are not read" in line]
    assert unread == {"x,y,so": ["by"], "x;y;z;": ["zone"]}.get(table[:6], [])


def test_the_next_command_holds_as_it_is_printed(tmp_path):
    _, lines = scenario_of(tmp_path, PLAIN, name="my slope.yaml")
    assert shlex.split(lines[-1].partition("next: ")[2]) == ["rock2d", "run", str(tmp_path / "my slope.yaml")]


def test_a_point_without_the_name_of_its_zone_is_refused_with_its_line(tmp_path):
    found = refusal(scenario_of, tmp_path, "station,height,zone\n0,40,rock\n20,25,\n80,0,\n", said="name of a zone")
    assert found.line == 3 and not (tmp_path / "s.yaml").exists()


CLIFF = np.array([[0, 62], [14, 60.5], [20, 37], [30, 30], [52, 15], [55, 11], [70, 8], [120, 2]], float)


@pytest.mark.parametrize(
    ("points", "low", "high", "said"),
    [
        (CLIFF, 14.0, 17.0, "upper half of x = 14 to 20 m, 76° .* x = 52 to 55 m, 53°"),
        (CLIFF - [0, 3], 14.0, 17.0, "highest stretch"),
        (np.vstack([CLIFF[:2], [[14, 37]], CLIFF[3:]]), 14.0, 14.4, "90°"),  # just beyond a vertical edge
        (np.array([[0, 30], [40, 28], [80, 4], [100, 3]], float), 40.0, 60.0, "steepest .* no ground is as steep"),
        (np.array([[0, 30], [10, 10], [40, 0]], float), 0.5, 5.0, "upper half"),  # not over the end of the survey
    ],
)
def test_blocks_start_on_the_upper_half_of_the_highest_steep_face(points, low, high, said):
    area = release_area(checked_profile(points, "it"), 1.0)
    assert (area.low_m, area.high_m) == pytest.approx((low, high), abs=1e-9)
    assert re.search(said, area.why)


def test_small_steps_are_no_face():
    x = np.linspace(0, 100, 401)
    steps = np.where(np.arange(401) % 8 < 4, 0.3, 0.0)  # 50° on a slope of 20° that steepens to 40°
    slope = np.where(x < 60, 70 - 0.36 * x, 70 - 0.36 * 60 - 0.84 * (x - 60))
    area = release_area(checked_profile(np.column_stack([x, slope + steps]), "it"), 1.0)
    assert 55 < area.low_m < 65 and "no ground is as steep" in area.why


def test_blocks_leave_the_start_that_is_found(tmp_path):
    """On the flat ground above the edge, where the upper end of the survey is, none did."""
    scenario, _ = scenario_of(tmp_path, rows_of(CLIFF))
    passing = run(scenario, releases=40).to_pandas("stops")
    assert (passing["runout_m"] > 5.0).mean() > 0.9


def test_a_start_beside_the_survey_is_refused(tmp_path):
    refusal(scenario_of, tmp_path, PLAIN, release=(70.0, 90.0), said="reaches from 0 to 80 m")


def test_the_ground_is_rough_by_soil_class_and_the_same_obstacle_counts_once(tmp_path):
    rough, smooth = (
        scenario_of(tmp_path, PLAIN, "0,30,rock\n30,60,swamp\n", name, smooth=name == "smooth.yaml")[0]
        for name in ("rough.yaml", "smooth.yaml")
    )
    sd_deg = {zone: keys.sd_deg for zone, keys in rough.roughness.items()}
    # the root mean square of U(0, 18°) and U(0, 14°); a swamp is smooth
    assert sd_deg == pytest.approx({"rock": 18 / 3**0.5, "slope": 14 / 3**0.5}, abs=0.01)
    assert smooth.roughness == {}
    ball = rough.make_blocks()["ball"]
    assert rough.rebound_parameters(ball) == smooth.rebound_parameters(ball)
    assert rough.contact_parameters(ball)["rock"] == smooth.contact_parameters(ball)["rock"]
    of_points = [run(own, engine="point_mass", releases=30).to_pandas("stops") for own in (rough, smooth)]
    pd.testing.assert_frame_equal(*of_points)  # the slope reduction is their roughness


def test_a_survey_of_a_site_that_cannot_be_leaves_nothing_behind(tmp_path):
    (tmp_path / "mm.csv").write_text("station,height\n0,60000\n60000,11000\n140000,0\n")
    refused = refusal(write_profile, tmp_path / "mm.csv", tmp_path / "3.yaml", said="Are its points in mm")
    assert refused.file == tmp_path / "mm.csv"
    assert [path.name for path in tmp_path.iterdir()] == ["mm.csv"]
    (tmp_path / "mm.csv").write_text("station,height\n0,60\n60,11\n140,0\n")
    write_profile(tmp_path / "mm.csv", tmp_path / "3.yaml", report=str)
    assert load_scenario(tmp_path / "3.yaml").name == "3"
