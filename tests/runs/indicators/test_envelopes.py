"""Envelopes against the closed form of a flight, and their percentiles against numpy's."""

from collections.abc import Mapping

import numpy as np
import pytest

from rock2d.records.track import Track
from rock2d.runs.indicators.envelopes import STATIONS, envelope_table
from rock2d.runs.simulation import Simulation
from rock2d.scene.blocks import Block, make_block
from rock2d.scene.cross_section import CrossSection
from tests import laboratory

GROUND = CrossSection([[0, 10], [20, 0], [60, 0]], ["slope", "floor"])
BALL = make_block("ball", "circle", 100.0, "solid_sphere", diameter_m=0.5)
G = 9.81


def flight(release: int, vx: float) -> Track:
    """A flight of 2 s from (0, 30) with a spin of 4 rad/s."""
    return laboratory.flight(release, "ball", [0.0, 30.0, 0.0, vx, 1.0, 4.0], 2.0, "time")


def flown(tracks: list[Track], own_blocks: Mapping[int, Block] | None = None) -> Simulation:
    return Simulation("batch", GROUND, {"ball": BALL}, tracks, own_blocks=own_blocks or {})


def values(table, quantity, percentile):
    own = table[(table["quantity"] == quantity) & (table["percentile"] == percentile)]
    return own.set_index("x_m")["value"]


def test_a_flight_passes_each_station_as_its_parabola_does():
    table = envelope_table(flown([flight(i, 15.0) for i in range(6)]))
    for x, height in values(table, "height_m", 50.0).items():
        t = x / 15.0
        assert height == pytest.approx(30 + t - 0.5 * G * t * t - GROUND.height_m([x])[0], abs=1e-4)
        speed = np.hypot(15.0, 1.0 - G * t)
        assert values(table, "speed_m_s", 50.0)[x] == pytest.approx(speed, rel=1e-6)
        spin_J = 0.5 * BALL.inertia_kg_m2 * 16.0
        assert values(table, "kinetic_J", 50.0)[x] == pytest.approx(50.0 * speed**2 + spin_J, rel=1e-6)
    reached = values(table, "height_m", 50.0).index
    assert reached.max() <= 30.0 < reached.max() + 60.0 / (STATIONS - 1)


def test_percentiles_are_those_of_the_blocks_that_come_past():
    speeds = np.linspace(5.0, 25.0, 151)
    table = envelope_table(flown([flight(i, v) for i, v in enumerate(speeds)]))
    at_30 = table[(table["x_m"] == 30.0) & (table["quantity"] == "speed_m_s")].set_index("percentile")
    past = speeds[speeds * 2.0 >= 30.0]
    assert set(at_30["passed"]) == {len(past)} and list(at_30.index) == [50.0, 95.0]  # 99 % needs 368
    expected = np.percentile(np.hypot(past, 1.0 - G * 30.0 / past), 95)
    assert at_30.loc[95.0, "value"] == pytest.approx(expected, rel=1e-6)


def test_energy_is_that_of_the_releases_own_block():
    heavy = make_block("ball", "circle", 300.0, "solid_sphere", diameter_m=0.5)
    tracks = [flight(i, 15.0) for i in range(6)]
    light = values(envelope_table(flown(tracks)), "kinetic_J", 50.0)
    own = values(envelope_table(flown(tracks, dict.fromkeys(range(6), heavy))), "kinetic_J", 50.0)
    assert own.to_numpy() == pytest.approx(3.0 * light.to_numpy())
