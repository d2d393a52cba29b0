"""Projects of Tracker: marked points are read in pixels, damage is told with its line, and no entity is expanded."""

import os
from pathlib import Path

import numpy as np
import pytest
from rock2d_tracking.importing import read_points

from tests.laboratory import CUBE, SPHERE
from tests.programs import refusal
from tests.tracking.tracked_files import imported, values

TRACKER = "org.opensourcephysics.cabrillo.tracker"
ORIGIN_PX, PX_PER_M, FPS = (100.0, 300.0), 400.0, 50.0


def mass(name: str, points: dict[int, tuple[float, float]]) -> str:
    frames = "".join(
        f'<property name="[{n}]" type="object"><object class="{TRACKER}.PointMass$FrameData">\n'
        f'<property name="x" type="double">{u!r}</property>\n<property name="y" type="double">{v!r}</property>\n'
        "</object></property>\n"
        for n, (u, v) in points.items()
    )
    return (
        f'<property name="item" type="object"><object class="{TRACKER}.PointMass">\n'
        f'<property name="name" type="string">{name}</property>\n'
        f'<property name="framedata" type="array">\n{frames}</property>\n</object></property>\n'
    )


def project(*masses: str) -> str:
    frame = "org.opensourcephysics.media.core.ImageCoordSystem"
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<object class="{TRACKER}.TrackerPanel">\n'
        '<property name="description" type="string"><![CDATA[x < y & so on]]></property>\n'
        '<property name="clipcontrol" type="object"><object><property name="delta_t">20.0</property></object>'
        "</property>\n"
        f'<property name="coords" type="object"><object class="{frame}"><property name="framedata">'
        f'<property name="[0]"><object><property name="xorigin">{ORIGIN_PX[0]}</property>'
        f'<property name="yorigin">{ORIGIN_PX[1]}</property><property name="angle">0.5</property>'
        f'<property name="xscale">{PX_PER_M}</property><property name="yscale">{PX_PER_M}</property>'
        "</object></property></property></object></property>\n"
        '<property name="length_unit" type="string">m</property>\n<property name="tracks" type="collection">\n'
        f'<property name="item" type="object"><object class="{TRACKER}.TapeMeasure"/></property>\n'
        f"{''.join(masses)}</property>\n</object>\n"
    )


def toss(frames: int = 12) -> dict[int, tuple[float, float]]:
    """Marks of a ball under 9.81 m/s² from the origin with 1.5 and 2.0 m/s, the first in frame 3."""
    t = np.arange(frames) / FPS
    u, v = ORIGIN_PX[0] + PX_PER_M * 1.5 * t, ORIGIN_PX[1] - PX_PER_M * (2.0 * t - 0.5 * 9.81 * t**2)
    return {3 + k: (float(a), float(b)) for k, (a, b) in enumerate(zip(u, v, strict=True))}


def test_marked_points_become_the_motion_that_they_show(put):
    said: list[str] = []
    seen = imported(
        put(project(mass("ball", toss())), "toss.trk"), "tracker", metres_per_unit=1 / PX_PER_M, y="down",
        fps=FPS, origin=(ORIGIN_PX[0] - 0.5, ORIGIN_PX[1] - 0.5), block=SPHERE, report=said.append,
    )  # fmt: skip
    t = seen["t_s"].to_numpy() - 3 / FPS
    np.testing.assert_allclose(seen["x_m"], 1.5 * t, atol=1e-12)
    np.testing.assert_allclose(seen["y_m"], 2.0 * t - 0.5 * 9.81 * t**2, atol=1e-12)
    assert "400 px per m, origin at (99.5, 299.5) px, axes turned by 0.5°, 50 frames/s" in said[0]


def test_points_of_two_marks_tell_the_orientation(put):
    marks = project(mass("a", {0: (10.0, 10.0), 1: (10.0, 10.0)}), mass("b", {0: (20.0, 10.0), 1: (10.0, 0.0)}))
    points = read_points(put(marks), "tracker")
    # Tracker counts from the corner of the first pixel
    assert values(points, "b") == [[19.5, 9.5], [9.5, -0.5]]
    assert points.table["frame"].tolist() == [0, 1, 0, 1]
    seen = imported(
        put(marks), "tracker", metres_per_unit=1.0, y="down", fps=1.0, block=CUBE, marks=("a", "b"),
        report=lambda _: None,
    )  # fmt: skip
    assert seen["theta_rad"].tolist() == pytest.approx([0.0, np.pi / 2])


def test_y_of_pixels_grows_downwards_whoever_says_otherwise(put):
    stated = {"metres_per_unit": 1.0, "y": "up", "fps": FPS, "block": SPHERE}
    error = refusal(imported, put(project(mass("ball", toss()))), "tracker", **stated)
    assert "state y down" in error.message


BOMB = '<!DOCTYPE o [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">]>\n'
OUTSIDE = '<!DOCTYPE o [<!ENTITY a SYSTEM "file:///etc/hostname">]>\n'


@pytest.mark.parametrize("type_", [BOMB, OUTSIDE])
def test_no_entity_is_expanded_and_no_other_file_opened(put, type_):
    head, rest = project(mass("&b;" if type_ is BOMB else "&a;", toss())).split("\n", 1)
    error = refusal(read_points, put(f"{head}\n{type_}{rest}"), "tracker")
    assert "document type" in error.message and error.line == 2


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda text: text[: len(text) // 2], "not XML"),
        (lambda text: text.replace("[5]", "[five]"), "expected a frame [0], [1], ..., found '[five]'"),
        (lambda text: text.replace('"double">112.0', '"double">1e999'), "column x: expected a number"),
        (lambda text: text.replace("TrackerPanel", "Panel"), "no project of Tracker"),
        (lambda text: text.replace(".PointMass", ".Vector"), "no marked point mass"),
        (lambda text: text.replace("</property>\n</object>\n", f"{mass('ball', toss())}</property>\n</object>\n"),
         "two tracks have the name 'ball'"),
        (lambda text: "<" * 100_000, "not XML"),
        (lambda text: "<a>" * 100_000, "not XML"),
        (lambda text: text.replace("[5]", "[4]"), "a second point in frame 4"),
    ],
)  # fmt: skip
def test_a_damaged_project_is_told_with_its_line(put, spoil, words):
    path = put(spoil(project(mass("ball", toss()))))
    error = refusal(imported, path, "tracker", metres_per_unit=1.0, y="down", fps=FPS, block=SPHERE, report=str)
    assert words in error.message and error.file == path and error.line


@pytest.mark.skipif(not os.environ.get("ROCK2D_DATA"), reason="needs the film under ROCK2D_DATA")
def test_the_marks_of_a_real_project_fall_with_gravity():
    path = Path(os.environ["ROCK2D_DATA"]) / "data/films/ball_toss/BallToss.trk"
    stated = {"metres_per_unit": 1 / 398.709, "y": "down", "fps": 1 / 0.066, "block": SPHERE}
    seen = imported(path, "tracker", **stated, report=lambda _: None)
    assert len(seen) == 11 and seen["t_s"].iloc[0] == pytest.approx(2 * 0.066)
    fall = np.polyfit(seen["t_s"], seen["y_m"], 2)
    assert np.std(seen["y_m"] - np.polyval(fall, seen["t_s"])) * 398.709 < 1.0  # px: marks made by hand
    assert -2 * fall[0] == pytest.approx(10.27, abs=0.01)  # 5 % above gravity: what the project states is off
