"""The point-mass engine beside PlatRock and PyRockfall: single paths bounce by bounce, then ensembles.

    ROCK2D_PEER_PYTHON=peers/bin/python python -m tests.benchmarks.compare_peers [--releases N] [--figure FILE]

prints the tables of docs/theory/other-codes.md and draws its figure. How to install the peers: `bench_peers`.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from scipy.stats import ks_2samp

from rock2d.engines.point_mass_batch import run_point_mass_batch
from rock2d.laws.rebound import ReboundParameters
from rock2d.records.columns import STOP_TIME
from rock2d.scene.blocks import make_block
from rock2d.scene.cross_section import CrossSection
from rock2d.statistics import percentile_interval
from tests.benchmarks.peer_scripts import PEERS

PLANE = [[0.0, 105.0], [150.0, 0.0]]
PROFILE = [[0, 62], [12, 46], [30, 32], [36, 31], [60, 13], [75, 6], [90, 3.5], [110, 2], [140, 1]]
STATIONS = np.arange(10.0, 111.0, 2.5)
SHOWN = (30.0, 50.0, 75.0)
GRAVITY, ELASTIC = 9.81, 1e300  # r_n = 1 to the last bit
SOIL = {"half_m_s": 2.5, "r_n": 0.4, "r_t": 0.85, "phi_deg": 0.0, "mu_r": 0.4, "slide_deg": 30.0, "alpha_deg": 0.0}
SINGLE = SOIL | {"radius_m": 0.5, "density": 2700.0, "velocity_m_s": [2.0, -1.0], "model": 2, "gravity": GRAVITY, "seed": 1}
LEG = X0, Y0, VX, VY, X1, ROLLS, END_SQUARE = range(7)  # from one contact to the next; v² at the end of a roll


def peer_legs(name, given):
    """Legs of each release, (legs, LEG), from a peer in a process of its own."""
    python = os.environ.get("ROCK2D_PEER_PYTHON", sys.executable)
    script = PEERS[name]
    environment = os.environ | {"PATH": f"{Path(python).absolute().parent}{os.pathsep}{os.environ['PATH']}"}
    done = subprocess.run([python, "-c", script], input=json.dumps(given), text=True, capture_output=True, env=environment)
    if done.returncode != 0:
        last = (done.stderr.strip() or done.stdout.strip()).splitlines()[-1]
        sys.exit(f"{name} does not run with {python} (ROCK2D_PEER_PYTHON): {last}")
    return [np.array(legs).reshape(-1, len(LEG)) for legs in json.loads(done.stdout.splitlines()[-1])]


def own_legs(given, elastic=False):
    """The same from rock2d; M½ = m v½ makes its law that of PlatRock."""
    mass = given["density"] * 4 / 3 * np.pi * given["radius_m"] ** 3
    block = make_block("ball", "circle", mass, diameter_m=2 * given["radius_m"])
    ground, starts = CrossSection(given["points_m"], ["soil"] * (len(given["points_m"]) - 1)), np.array(given["starts_m"])
    half = ELASTIC if elastic else block.mass_kg * given["half_m_s"]
    law = ReboundParameters(given["phi_deg"], half, given["r_t"], given["alpha_deg"], "uniform")
    states = np.zeros((len(starts), 6))
    states[:, 0], states[:, 1] = starts[:, 0], np.interp(starts[:, 0], *ground.points_m.T) + starts[:, 1]
    states[:, 3:5] = given["velocity_m_s"]
    seeds = given["seed"] * 10**6 + np.arange(len(starts))
    run = run_point_mass_batch(
        block, ground, {"default": law}, states, seeds, gravity_m_s2=GRAVITY, time_limit_s=600.0, impact_room=4000
    )
    assert run.impact_count.max() <= 4000
    assert elastic or not (run.stop == STOP_TIME).any()
    result = []
    for state, impacts, count, end in zip(states, run.impacts, run.impact_count, run.ends, strict=True):
        rows = impacts[:count]
        begin = np.vstack([state[[0, 1, 3, 4]], rows[:, [1, 2, 7, 8]]])
        result.append(np.column_stack([begin, np.append(rows[:, 1], end[1]), np.zeros((count + 1, 2))]))
    return result


def single_paths():
    """Bounces of one release until a peer rolls or slides: largest differences of place and velocity."""
    print("| ground, law | peer | bounces | largest difference of place | of velocity |\n|---|---|---|---|---|")
    for ground, points in (("plane", PLANE), ("8 facets", PROFILE)):
        for peer, elastic, law in (("PlatRock", False, "r_n(v), φ = 0"), ("PlatRock", True, "r_n = 1"), ("PyRockfall", True, "r_n = 1")):
            given = SINGLE | {"points_m": points, "starts_m": [[2.0, 3.0]], "r_n": 1.0, "model": 0 if elastic else 2}
            theirs, mine = peer_legs(peer, given)[0], own_legs(given, elastic)[0]
            n = min(len(mine), int(np.append(np.flatnonzero(theirs[:, ROLLS]), len(theirs))[0]))
            gap = np.abs(theirs[:n, :X1] - mine[:n, :X1])
            print(f"| {ground}, {law} | {peer} | {n - 1} | {gap[:, :2].max():.1e} m | {gap[:, 2:].max():.1e} m/s |")
    along = np.array([150.0, -105.0]) / np.hypot(150.0, 105.0)
    for phi in (10.0, 89.0):
        given = SINGLE | {"points_m": PLANE, "starts_m": [[2.0, 3.0]], "phi_deg": phi}
        own, peer = (legs[0][1:3, [VX, VY]] @ along for legs in (own_legs(given), peer_legs("PlatRock", given)))
        print(f"φ = {phi:g}°: v_t after bounces 1, 2: rock2d {own.round(4)}, PlatRock {peer.round(4)} m/s")


def crossings(paths, points, mass):
    """By station: (released that pass, 2) kinetic energy in kJ and height in m at the first passing."""
    legs = np.vstack(paths)
    release = np.repeat(np.arange(len(paths)), [len(path) for path in paths])
    found = []
    for x in STATIONS:
        over = np.flatnonzero((np.minimum(legs[:, X0], legs[:, X1]) <= x) & (np.maximum(legs[:, X0], legs[:, X1]) > x))
        leg = legs[over[np.unique(release[over], return_index=True)[1]]]
        tau = (x - leg[:, X0]) / leg[:, VX]
        square = leg[:, VX] ** 2 + (leg[:, VY] - GRAVITY * tau) ** 2
        height = leg[:, Y0] + leg[:, VY] * tau - GRAVITY / 2 * tau**2 - np.interp(x, *np.transpose(points))
        start, share = leg[:, VX] ** 2 + leg[:, VY] ** 2, (x - leg[:, X0]) / (leg[:, X1] - leg[:, X0])
        rolls = leg[:, ROLLS] > 0
        square = np.where(rolls, start + share * (leg[:, END_SQUARE] - start), square)
        found.append(np.column_stack([mass * square / 2000, np.where(rolls, 0.0, height)]))
    return found


def ensembles(releases):
    """Results by (size, code): crossings and stops, on the same starts with each code's own random angles."""
    rng, results = np.random.default_rng(7), {}
    starts = np.column_stack([rng.uniform(1.0, 6.0, releases), rng.uniform(1.0, 4.0, releases)]).tolist()
    shared = SINGLE | {"points_m": PROFILE, "starts_m": starts, "alpha_deg": 15.0}
    for size, radius, peers in (("1 m", 0.5, ("PlatRock", "PyRockfall")), ("2 cm", 0.01, ("PlatRock",))):
        given = shared | {"radius_m": radius}
        runs = {"rock2d": own_legs(given), "rock2d, other seeds": own_legs(given | {"seed": 2})}
        runs |= {peer: peer_legs(peer, given) for peer in peers}
        mass = given["density"] * 4 / 3 * np.pi * 0.5**3  # the same scale of energy for both sizes
        for code, paths in runs.items():
            results[size, code] = crossings(paths, PROFILE, mass), np.array([path[-1, X1] for path in paths])
    return results


def table(results):
    for (size, code), (passing, stops) in results.items():
        own_passing, own_stops = results[size, "rock2d"]
        print(f"\n{size}, {code}; stops 5, 50, 95 %: {np.percentile(stops, [5, 50, 95]).round(1)} m, KS p {ks_2samp(stops, own_stops).pvalue:.2g}")
        for x in SHOWN:
            k = int(np.flatnonzero(STATIONS == x)[0])
            for j, what in enumerate(("kJ", "m")):
                v, p = passing[k][:, j], ks_2samp(passing[k][:, j], own_passing[k][:, j]).pvalue
                low, high = percentile_interval(v, 95.0)
                print(f"x {x:g} m: {len(v)} pass; {what}: mean {v.mean():.3g}, 95 % {np.percentile(v, 95):.3g} ({low:.3g} to {high:.3g}), max {v.max():.3g}, KS p {p:.2g}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="The point-mass engine beside PlatRock and PyRockfall.")
    parser.add_argument("--releases", type=int, default=2000)
    options = parser.parse_args()
    single_paths()
    table(ensembles(options.releases))
