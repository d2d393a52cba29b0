"""Instructions after a diagnosis: following one undoes the effect; keys that it names exist; doubt corrects nothing."""

import json
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from rock2d_tracking.camera import PixelMap

from rock2d.diagnosis import diagnosis_content
from rock2d.diagnosis.attribution import Attribution
from rock2d.diagnosis.report import what_to_do as module
from rock2d.diagnosis.report.what_to_do import instruction, what_to_do
from rock2d.effects import catalogue
from rock2d.files.experiment import TRAJECTORY_COLUMNS, Experiment
from rock2d.kinematics.setup_world import setup_world
from rock2d.laws.contact import K_L, K_UL, MU
from rock2d.scene.cross_section import CrossSection
from rock2d.schemas import SCHEMAS, file_schema
from tests import diagnosed_files
from tests.kinematics.synthetic_films import BLOCKS, POINTS, SOIL, ZONES

FPS = 1000.0
NUMBER = r"(-?\d+(?:\.\d+)?)"
EXPERIMENT = Experiment("tests", 9.81, FPS, 3e-4, 0.02, CrossSection(POINTS, ZONES), dict(BLOCKS),
                        trajectories=pd.DataFrame(columns=list(TRAJECTORY_COLUMNS)))  # fmt: skip
# a camera that nobody has corrected yet: it is tilted, and the set-up file knows of a part of that
STATED = PixelMap(2.5e-4, (212.0, 640.0), (0.0, 0.0), -1, np.deg2rad(1.5))


def parameters(name: str, *values: float, half: float = 1e-6) -> dict:
    """Parameters of an effect as diagnosis.json has them, known to `half`."""
    known = catalogue()[name].parameters
    return {
        p.name: {"value": v, "ci95": [v - half, v + half], "unit": p.unit} for p, v in zip(known, values, strict=True)
    }


def said(name: str, *values: float, experiment: Experiment = EXPERIMENT) -> str:
    """The instruction about an effect with these values, digits as they are known."""
    fit = {"base": SOIL, "parameters": {name: parameters(name, *values)}}
    return instruction(name, fit, experiment)


def number(pattern: str, text: str) -> float:
    """The number that stands for {} in `pattern`."""
    found = re.search(re.escape(pattern).replace(r"\{\}", NUMBER), text)
    assert found, f"{pattern!r} is not in {text!r}"
    return float(found.group(1))


def origin(text: str) -> tuple[float, float]:
    return number("origin_m: [{},", text), float(re.search(rf"origin_m: \[[^,]*, {NUMBER}\]", text).group(1))


def recorded(name: str, *values: float) -> tuple[np.ndarray, np.ndarray, str]:
    """True poses (n, 3), what a camera with the effect records of them, and the instruction."""
    rng = np.random.default_rng(3)
    true = np.column_stack([rng.uniform(-0.3, 0.5, 40), rng.uniform(0, 0.3, 40), rng.uniform(-2, 9, 40)])
    return (true, catalogue()[name].apply(setup_world(EXPERIMENT), values).view.record(true), said(name, *values))


@pytest.mark.parametrize("tilt", [-0.035, 0.06])
@pytest.mark.parametrize("up", [-1, 1])
def test_the_tilt_in_the_set_up_file_undoes_camera_tilt(tilt, up):
    true, poses, text = recorded("camera_tilt", tilt, 0.2, -0.3)
    stated = replace(STATED, up=up)
    seen, angle = stated.to_pixel(poses[:, :2]), stated.angle_to_pixel(poses[:, 2])
    turn = np.deg2rad(number("tilt_deg: {}", text))
    assert "where `up` is down, with the other sign" in text
    tracked = replace(stated, tilt_rad=stated.tilt_rad + turn, origin_m=origin(text))  # as set-up files give it
    assert np.allclose(tracked.to_world(seen), true[:, :2], atol=1e-5)
    assert np.allclose(tracked.angle_to_world(angle), true[:, 2], atol=1e-5)


@pytest.mark.parametrize("tilt", [-0.035, 0.06])
def test_turning_the_record_by_hand_undoes_camera_tilt(tilt):
    true, poses, text = recorded("camera_tilt", tilt, 0.2, -0.3)
    turn = np.deg2rad(number("turn every position by {}°", text))
    centre = np.array(re.search(rf"about \({NUMBER}, {NUMBER}\) m, counter", text).groups(), float)
    c, s = np.cos(turn), np.sin(turn)
    turned = (poses[:, :2] - centre) @ np.array([[c, s], [-s, c]]) + centre
    assert np.allclose(turned, true[:, :2], atol=1e-4)
    assert np.allclose(poses[:, 2] + number("add {} to every `theta_rad`", text), true[:, 2], atol=1e-5)


def test_correcting_the_record_by_hand_undoes_keystone_distortion():
    true, poses, text = recorded("keystone_distortion", 0.08, -0.06, 0.2, -0.3)
    assert "shrink by 8.00000 % to the right and 6.00000 % downwards" in text
    linear = rf"{NUMBER} u ([+−]) {NUMBER} v"
    found = re.search(rf"from \({NUMBER}, {NUMBER}\) m by {NUMBER} − \({linear}\), and subtract {linear} from", text)
    x, y, scale, a, sign, b, of_u, sign_of_v, of_v = (
        float({"+": "1", "−": "-1"}.get(part, part)) for part in found.groups()
    )
    b, of_v = sign * b, sign_of_v * of_v
    u, v = (poses[:, :2] - [x, y]).T
    corrected = np.column_stack([u, v]) / (scale - (a * u + b * v))[:, None] + [x, y]
    assert np.allclose(corrected, true[:, :2], atol=1e-4)
    # to second order in the rotation of a small body
    assert np.allclose(poses[:, 2] - (of_u * u + of_v * v), true[:, 2], atol=4e-3)
    # a way whose interval contains 0 is not stated
    assert "shrink by 8.00000 % to the right: the camera" in said("keystone_distortion", 0.08, 1e-7, 0.2, -0.3)


@pytest.mark.parametrize("scale", [0.95, 1.04])
def test_the_corrected_calibration_length_undoes_scale_error(scale):
    true, poses, text = recorded("scale_error", scale, 1.0, -0.4, 0.1)
    assert f"too {'long' if scale > 1 else 'short'}" in text
    seen = STATED.to_pixel(poses[:, :2])
    factor = number("whichever is given there, by {}.", text)
    # distance_m and square_m give metres per pixel in proportion
    tracked = replace(STATED, metres_per_pixel=factor * STATED.metres_per_pixel, origin_m=origin(text))
    assert np.allclose(tracked.to_world(seen), true[:, :2], atol=1e-5)


def test_different_scales_along_x_and_y_are_undone_in_the_record():
    true, poses, text = recorded("scale_error", 0.95, 1.012, -0.4, 0.1)
    assert "differ by 1.2" in text and "metres_per_pixel" not in text
    centre = np.array(re.search(rf"from \({NUMBER}, {NUMBER}\) m by", text).groups(), float)
    factors = [number("m by {} along x", text), number("and by {} along y", text)]
    assert np.allclose(centre + (poses[:, :2] - centre) * factors, true[:, :2], atol=1e-5)


@pytest.mark.parametrize("time_scale", [0.9, 1.08])
def test_the_true_rate_undoes_frame_rate_error(time_scale):
    # frames that the camera took at another rate than the stated one
    true_s = np.arange(50) * time_scale / FPS
    view = catalogue()["frame_rate_error"].apply(setup_world(EXPERIMENT), [time_scale]).view
    recorded_s = true_s / view.time_scale  # see `View`
    text = said("frame_rate_error", time_scale)
    frames = recorded_s * FPS
    assert np.allclose(frames / number("`fps: {}` in the set-up file", text), true_s, rtol=1e-5)
    assert np.allclose(recorded_s * number("multiply every `t_s` by {}", text), true_s, rtol=1e-5)
    assert ("of its frames are missing" in text) == (time_scale > 1.0)
    if time_scale > 1.0:  # a film of the stated rate takes `time_scale` as many frames
        assert np.isclose(1.0 - number("or {} % of its frames", text) / 100.0, 1.0 / time_scale, rtol=1e-3)


@pytest.mark.parametrize("offset", [-0.2, 0.31])
def test_adding_the_number_undoes_angle_offset(offset):
    true, poses, text = recorded("angle_offset", offset)
    added = number("Add {} to every `theta_rad`", text)
    assert np.allclose(poses[:, 2] + added, true[:, 2], atol=1e-5)


@pytest.mark.parametrize("edge", [-0.03, 0.04])
def test_the_distortion_in_the_set_up_file_undoes_lens_distortion(edge):
    true, poses, text = recorded("lens_distortion", edge, 0.1, 0.2)
    level = replace(STATED, tilt_rad=0.0)
    seen = level.to_pixel(poses[:, :2])
    middle = np.array(re.search(rf"shows \({NUMBER}, {NUMBER}\) m", text).groups(), float)
    centre, half = level.to_pixel(middle), 800.0  # px
    k = number("K = {} × D²", text) * (half * level.metres_per_pixel) ** 2
    origin_px = tuple(level.to_pixel(np.zeros(2)))
    tracked = replace(level, k=k, centre_px=tuple(centre), half_px=half, origin_px=origin_px)
    # the mapped origin moves, too; the shape of the record is what counts
    shift = tracked.to_world(centre) - middle
    assert np.allclose(tracked.to_world(seen) - shift, true[:, :2], atol=2e-5)
    assert np.abs(poses[:, :2] - true[:, :2]).max() > 2e-4


@pytest.mark.parametrize(("axis", "column"), [(1, "x_m"), (2, "y_m"), (3, "theta_rad")])
def test_the_mirrored_column_is_named(axis, column):
    true, poses, text = recorded("mirrored_axis", float(axis))
    other = [i for i in range(3) if not np.allclose(poses[:, i], true[:, i])]
    assert other == [axis - 1]
    assert f"Change the sign of every `{column}`" in text
    table = replace(EXPERIMENT, trajectories=None, impacts=pd.DataFrame())
    assert "_after_" in said("mirrored_axis", float(axis), experiment=table)


def test_the_stated_inertia_is_that_of_the_effect():
    true = catalogue()["inertia_error"].apply(setup_world(EXPERIMENT), [1.3])
    text = said("inertia_error", 1.3)
    for name, block in true.blocks.items():
        written = re.search(rf"{name} `inertia: ([\d.e+-]+)`", text).group(1)
        assert float(written) == pytest.approx(block.inertia_kg_m2, rel=1e-3)


@pytest.mark.parametrize("points", [POINTS, [[-1.0, 0.5], [1.0, 0.0]]])
def test_the_stated_cross_section_is_that_of_the_effect(points):
    section = CrossSection(points, ZONES[: len(points) - 1])
    experiment = replace(EXPERIMENT, cross_section=section)
    true = catalogue()["geometry_error"].apply(setup_world(experiment), [0.05, -0.1]).cross_section
    text = said("geometry_error", 0.05, -0.1, experiment=experiment)
    written = json.loads(re.search(r"points_m: (\[\[.*?\]\])", text).group(1))
    assert np.allclose(written, true.points_m, rtol=1e-3)
    assert "lower" in text and ("steeper" if len(points) > 2 else "up to the right") in text


@pytest.mark.parametrize(
    ("place", "zones"),
    [(0.0, "`uphill_face`, `crest`, `downhill_face`"), (1.0, "the face of the embankment its own soil")],
)
def test_the_stated_soil_of_the_embankment_is_that_of_the_effect(place, zones):
    world = setup_world(EXPERIMENT)
    world.contact[..., [K_L, K_UL, MU]] = 1.1e4, 7.0e4, np.tan(np.deg2rad(32.0))
    rows = catalogue()["zone_contrast"].apply(world, [2.0, 0.8, 1.2, place]).contact[0]
    row = rows[ZONES.index("uphill_face")]
    assert (rows[ZONES.index("crest"), K_L] == row[K_L]) == (place == 0.0)
    text = said("zone_contrast", 2.0, 0.8, 1.2, place)
    assert number("k_l_N_m: {}", text) == pytest.approx(row[K_L], rel=1e-3)
    assert number("k_ul_N_m: {}", text) == pytest.approx(row[K_UL], rel=1e-3)
    assert np.tan(np.deg2rad(number("friction_angle_deg: {}", text))) == pytest.approx(row[MU], rel=1e-2)
    assert zones in text


def known_keys() -> set[str]:
    """Every key of scenario, experiment and set-up files, and the columns of the tables."""
    schemas = " ".join(json.dumps(file_schema(kind)) for kind in SCHEMAS)
    columns = {"t_s", "x_m", "y_m", "theta_rad"}
    return set(re.findall(r'"(\w+)": \{', schemas)) | columns


@pytest.mark.parametrize("name", catalogue())
def test_an_instruction_names_only_keys_that_exist(name):
    high = [p.choices[-1] if p.choices else 0.5 * (p.neutral + p.high) for p in catalogue()[name].parameters]
    text = said(name, *high)
    assert "nan" not in text and len(text) > 100
    named = [words for words in re.findall(r"`([^`]+)`", text) if not words.startswith(("rock2d", "--"))]
    zones_and_sections = {*ZONES, "deterministic", "default"}
    for words in named:
        for key in re.findall(r"(\w+)(?=:|$)", words.split("[")[0]):
            if not re.fullmatch(r"[\d.e+-]+|K|polygon", key):
                assert key in known_keys() | zones_and_sections, f"{name}: no key {key!r}"


def content(verdict: str, chance: float = 0.95, rivals: tuple[str, ...] = ()) -> dict:
    names = [n for n in (verdict, *rivals) if n in catalogue()]
    fitted = {
        "camera_tilt": (-0.035, 0.0, 0.0),
        "geometry_error": (0.05, 0.1),
        "air_drag": (0.05,),
        "scale_error": (1.04, 1.0, 0.0, 0.0),
        "frame_rate_error": (1.02,),
    }
    found = {n: {"base": SOIL, "parameters": parameters(n, *fitted[n])} for n in names}
    return diagnosed_files.content(
        verdict, found, group=names, probabilities={verdict: chance}, base=SOIL,
        next_release="A cube that strikes the ditch.", sanity={"faults": [], "remarks": []},
    )  # fmt: skip


@pytest.mark.parametrize(("low", "named"), [(0.5, True), (0.02, False)])
def test_effects_beside_an_unknown_cause_are_named_if_they_close_a_part_of_the_gap(low, named):
    own = content("unknown")
    own["causes"] = [{"effect": "air_drag", "p": 0.9, "closes": 0.6, "closes_ci95": [low, 0.7]}]
    first = what_to_do(own, EXPERIMENT)[0]
    assert ("air drag" in first and "60 %" in first) == named
    assert first.startswith("Do not correct anything") != named


@pytest.mark.parametrize(("verdict", "p"), [("unknown", 0.9), ("air_drag", 0.9), ("unknown", 0.2)])
def test_a_frame_that_moves_in_each_release_sends_the_user_to_a_fixed_mark(verdict, p):
    own = content(verdict) | {"outside": {"p": p, "share": 0.0, "depends_on": ["release"], "learnt": None}}
    assert any("fixed mark" in line for line in what_to_do(own, EXPERIMENT)) == (p > 0.5)


def test_a_scale_whose_aspect_is_not_clear_is_one_scale():
    """An aspect within its interval changes neither the factor nor the origin that are to be set."""
    fits = [
        {"base": SOIL, "parameters": {"scale_error": parameters("scale_error", 1.04, aspect, 0.1, 0.2, half=0.01)}}
        for aspect in (1.0, 1.005)
    ]
    assert len({instruction("scale_error", fit, EXPERIMENT) for fit in fits}) == 1


@pytest.mark.parametrize(("name", "at_end", "inside", "said_of_range"), [
    ("scale_error", (1.04, 0.97, 0.1, 0.2), (1.04, 0.975, 0.1, 0.2), "(0.97 to 1.03) of this value: scale along x"),
    ("camera_tilt", (-0.15, 0.1, 0.2), (-0.14, 0.1, 0.2), "range (−8.59 to 8.59 °) of"),
])  # fmt: skip
def test_a_value_at_the_end_of_its_range_is_no_measurement(name, at_end, inside, said_of_range):
    text = said(name, *at_end)
    assert "It is no measurement" in text and said_of_range in text
    assert "no measurement" not in said(name, *inside)


def test_a_value_of_one_block_at_the_end_of_its_range_is_no_measurement():
    """The range of a drag grows with the size of the block."""
    drag = catalogue()["air_drag"].parameters[0]
    ends = {name: drag.at(block.size_m, 9.81).high for name, block in BLOCKS.items()}
    first, *others = BLOCKS
    values = {first: ends[first]} | {name: 0.5 * ends[name] for name in others}
    own = parameters("air_drag", float(np.mean([*values.values()])))
    known = {"ci95": [0.0, 1.0], "drag_coefficient": {"value": 0.5, "ci95": [0.0, 1.0]}}
    own[drag.name]["by_block"] = {name: {"value": v, **known} for name, v in values.items()}
    text = instruction("air_drag", {"base": SOIL, "parameters": {"air_drag": own}}, EXPERIMENT)
    assert text.count("no measurement") == 1 and f"value: {first}, " in text


@pytest.mark.parametrize("verdict", ["none", "unknown"])
def test_without_a_cause_nothing_is_corrected(verdict):
    lines = what_to_do(content(verdict), EXPERIMENT)
    assert lines[0].startswith(("Correct nothing", "Do not correct anything"))
    assert "Film next: A cube that strikes the ditch." in lines
    assert not any("Set `" in line for line in lines)


def test_a_block_that_sinks_is_asked_about_before_nothing_is_corrected():
    """A size ten times too large leaves no gap in flights and impacts; the remark must not stand apart."""
    own = content("none")
    own["sanity"]["remarks"] = ["block cube sinks 0.08 m into the ground: are its size and the origin right?"]
    lines = what_to_do(own, EXPERIMENT)
    assert lines[0].startswith("Answer this first") and lines[0].endswith(own["sanity"]["remarks"][0])
    assert "correct nothing" in lines[1]


@pytest.mark.parametrize(("chance", "rivals"), [(0.6, ("geometry_error",)), (0.3, ())])
def test_in_doubt_the_next_release_comes_before_any_correction(chance, rivals):
    lines = what_to_do(content("camera_tilt", chance, rivals), EXPERIMENT)
    assert lines[0].startswith("Do not correct anything yet")
    assert lines[1].startswith("Film next")
    assert [line for line in lines if line.startswith("If it is camera tilt: ")]
    assert all(any(line.startswith(f"If it is {r.replace('_', ' ')}") for line in lines) for r in rivals)


def test_of_scale_and_frame_rate_both_are_measured_before_either_is_corrected():
    lines = what_to_do(content("scale_error", 0.5, ("frame_rate_error",)), EXPERIMENT)
    assert lines[0].startswith("Measure a length in the plane of motion, and film a clock")
    assert [line[:16] for line in lines[1:3]] == ["If it is scale e", "If it is frame r"]


def test_a_clear_verdict_begins_with_its_instruction():
    assert what_to_do(content("camera_tilt"), EXPERIMENT)[0].startswith("The picture is turned by 2.0")
    assert any("rock2d predict" in line for line in what_to_do(content("air_drag"), EXPERIMENT))
    assert not any("rock2d predict" in line for line in what_to_do(content("camera_tilt"), EXPERIMENT))


def test_an_effect_beside_the_verdict_is_corrected_after_it():
    both = content("camera_tilt")
    fits = {"camera_tilt": parameters("camera_tilt", 0.01, 0, 0), "air_drag": parameters("air_drag", 0.07)}
    both["beside"] = [{"effect": "air_drag", "base": SOIL, "parameters": fits}]
    lines = what_to_do(both, EXPERIMENT)
    assert "0.57" in lines[0]  # degrees, of the joint fit
    assert "one cause at a time" in lines[1] and "7.0" in lines[2]


class Answered(SimpleNamespace):
    answer = Attribution.answer


@pytest.mark.parametrize(
    ("verdict", "others"),
    [("scale_error", ["air_drag"]), ("air_drag", ["scale_error"]), ("frame_rate_error", []), ("unknown", [])],
)
def test_all_causes_of_the_joint_fit_but_the_verdict_stand_beside_it(verdict, others, monkeypatch):
    """The verdict need not be the effect that gains most alone, which may share its name. Where it is a rival of the
    chain, no joint fit holds it."""
    monkeypatch.setattr(diagnosis_content, "_law_json", lambda fit: {"fit": fit})
    chain = [
        SimpleNamespace(effect=SimpleNamespace(name=name), fit="joint", total=1.0, error=0.1)
        for name in ("scale_error", "air_drag")
    ]
    found = diagnosis_content.beside_verdict(Answered(verdict=verdict, chain=chain))
    assert [(one["effect"], one["fit"]) for one in found] == [(name, "joint") for name in others]


def test_a_twin_beside_the_verdict_is_measured_before_it_is_corrected():
    both = content("air_drag")
    fits = {"air_drag": parameters("air_drag", 0.07), "frame_rate_error": parameters("frame_rate_error", 0.98)}
    both["beside"] = [{"effect": "frame_rate_error", "base": SOIL, "parameters": fits}]
    both["causes"] = [{"effect": "frame_rate_error", "group": ["scale_error"], "closes": 0.3}]
    said = what_to_do(both, EXPERIMENT)[2]
    assert said.startswith("These data cannot tell frame rate error and scale error apart. Measure a length")
    assert "If it is frame rate error: The film was taken with" in said


def test_an_effect_without_a_remedy_gets_a_sentence(monkeypatch):
    bare = {"air_drag": replace(catalogue()["air_drag"], remedy=None)}
    monkeypatch.setattr(module, "catalogue", lambda: bare)
    text = said("air_drag", 0.05)
    assert catalogue()["air_drag"].summary in text and "0.05" in text
