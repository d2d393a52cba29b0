"""The point-mass engine beside PlatRock and PyRockfall: single paths bounce by bounce, then ensembles.

    ROCK2D_PEER_PYTHON=peers/bin/python python -m tests.benchmarks.compare_peers docs/pictures/peers.png

prints the tables of docs/theory/rebound-law.md and draws its figure. `bench_peers` says how to install the peers."""

import sys
from itertools import product

import numpy as np
from scipy.stats import ks_2samp

from rock2d.engines.point_mass import run_point_mass_batch
from rock2d.graphics.figure_style import LINESTYLES, blank_figure, finish, save_figure
from rock2d.laws.rebound import ReboundParameters
from rock2d.scene.blocks import make_block
from rock2d.scene.cross_section import CrossSection
from tests.benchmarks.peer_scripts import peer_legs

PROFILE = [[0, 62], [12, 46], [30, 32], [36, 31], [60, 13], [75, 6], [90, 3.5], [110, 2], [140, 1]]
GROUNDS = {"plane of 35°": [[0, 105], [150, 0]], "8 facets": PROFILE}
STATIONS, SHOWN = np.arange(8.0, 113.0), (30.0, 50.0, 75.0)
HYPERBOLIC, CONSTANT, ELASTIC = {"model": 2, "r_n": 1.0}, {"model": 0, "r_n": 0.3}, {"model": 0, "r_n": 1.0}
GIVEN = {
    "half_m_s": 2.5, "r_t": 0.85, "phi_deg": 0.0, "alpha_deg": 15.0, "angle": "uniform", "mu_r": 0.4, "slide_deg": 30.0,
    "radius_m": 0.5, "density": 2700.0, "velocity_m_s": [2.0, -1.0], "gravity": 9.81, "seed": 1, "points_m": PROFILE,
}  # fmt: skip
SINGLE = GIVEN | {"angle": "constant", "radius_m": 0.01, "starts_m": [[2.0, 3.0]]}  # a small block rolls late
SMOOTH = HYPERBOLIC | {"alpha_deg": 0.0}
CASES = [  # rock2d, the peer
    ("r_n(v), 15°", HYPERBOLIC, "PlatRock", HYPERBOLIC), ("r_n(v), 0°", SMOOTH, "PlatRock", SMOOTH),
    ("1, 15°", ELASTIC, "PyRockfall", ELASTIC), ("r_n(v), 15°", HYPERBOLIC, "PlatRock, r_n = 0.3", CONSTANT),
    ("r_n(v), 15°", HYPERBOLIC, "PyRockfall, r_n = 0.3", CONSTANT),
]  # fmt: skip
COLOURS = ("#0072B2", "#D55E00", "#9C4F86", "#009E73")
X0, Y0, VX, VY, X1, ROLLS, END_SQUARE = range(7)  # a leg, from contact to contact; v² at its end if it rolls
SPREAD = np.mean, lambda values: np.percentile(values, 95), np.max


def own_legs(given):
    """Legs of each release from rock2d. M½ = m v½ makes its law that of PlatRock, a boundless M½ gives r_n = 1."""
    mass = given["density"] * 4 / 3 * np.pi * given["radius_m"] ** 3
    half = 1e300 if given["model"] == 0 else mass * given["half_m_s"]
    law = ReboundParameters(given["phi_deg"], half, given["r_t"], given["alpha_deg"], given["angle"])
    ground = CrossSection(given["points_m"], ["soil"] * (len(given["points_m"]) - 1))
    block = make_block("ball", "circle", mass, diameter_m=2 * given["radius_m"])
    x, height = np.transpose(given["starts_m"])
    states = np.zeros((len(x), 6))
    states[:, 0], states[:, 1] = x, np.interp(x, *ground.points_m.T) + height
    states[:, 3:5] = given["velocity_m_s"]
    limits = {"time_limit_s": 60.0, "impact_room": 3000}
    run = run_point_mass_batch(block, ground, {"default": law}, states, np.arange(len(x)), **limits)
    result = []
    for state, impacts, end in zip(states, run.impacts, run.ends, strict=True):
        rows = impacts[np.isfinite(impacts[:, 0])]
        begin = np.vstack([state[[0, 1, 3, 4]], rows[:, [1, 2, 7, 8]]])
        result.append(np.column_stack([begin, np.append(rows[:, 1], end[1]), np.zeros((len(begin), 2))]))
    return result


def single_paths():
    """Bounces of one release for as long as both codes do the same: largest differences of place and velocity."""
    print("| ground | r_n | α | peer | bounces | place | velocity | the peer then |\n" + "|---" * 8 + "|")
    laws = [("PlatRock", "r_n(v)", HYPERBOLIC), ("PlatRock", 1, ELASTIC), ("PyRockfall", 1, ELASTIC)]
    for (ground, points), alpha, (peer, r_n, law) in product(GROUNDS.items(), (0.0, 10.0), laws):
        given = SINGLE | {"points_m": points, "alpha_deg": alpha} | law
        own, theirs = own_legs(given)[0], peer_legs(peer, given)[0]
        n = min(len(own), len(theirs))
        gap = np.abs(theirs[:n, :X1] - own[:n, :X1])
        apart = np.flatnonzero((gap.max(axis=1) > 1e-6) | (theirs[:n, ROLLS] > 0))
        then = "leaves as rock2d does" if len(own) == len(theirs) else "ends"
        if len(apart):
            n = apart[0]
            then = "rolls" if theirs[n, ROLLS] else f"parts where v_x = {own[n - 1, VX]:.2g} m/s"
        worst = f"{gap[:n, :VX].max():.0e} m | {gap[:n, VX:].max():.0e} m/s"
        print(f"| {ground} | {r_n} | {alpha:g}° | {peer} | {n - 1} | {worst} | {then} |")
    along = np.array([150.0, -105.0]) / np.hypot(150.0, 105.0)
    for phi in (10.0, 89.0):
        given = SINGLE | {"points_m": GROUNDS["plane of 35°"], "alpha_deg": 0.0, "phi_deg": phi} | HYPERBOLIC
        both = own_legs(given), peer_legs("PlatRock", given)
        own, peer = (legs[0][1:3, [VX, VY]] @ along for legs in both)
        print(f"φ = {phi:g}°: v_t after bounces 1, 2: rock2d {own.round(3)}, PlatRock {peer.round(3)} m/s")


def crossings(paths):
    """By station: kinetic energy of 1 t in kJ and height in m of each release at its first passing, (n, 2)."""
    legs, g, found = np.vstack(paths), GIVEN["gravity"], []
    release = np.repeat(np.arange(len(paths)), [len(path) for path in paths])
    low, high = np.sort(legs[:, [X0, X1]], axis=1).T
    for x in STATIONS:
        over = np.flatnonzero((low <= x) & (high > x))
        leg = legs[over[np.unique(release[over], return_index=True)[1]]].T
        tau, share, rolls = (x - leg[X0]) / leg[VX], (x - leg[X0]) / (leg[X1] - leg[X0]), leg[ROLLS] > 0
        flies, begin = leg[VX] ** 2 + (leg[VY] - g * tau) ** 2, leg[VX] ** 2 + leg[VY] ** 2
        square = np.where(rolls, begin + share * (leg[END_SQUARE] - begin), flies)
        height = leg[Y0] + leg[VY] * tau - g / 2 * tau**2 - np.interp(x, *np.transpose(PROFILE))
        found.append(np.column_stack([square / 2, np.where(rolls, 0.0, height)]))
    return found


def ensembles(releases=2000):
    """Print the table; return (crossings, stops) by code, with r_n(v) and 15°."""
    rng, drawn = np.random.default_rng(7), {}
    starts = {"starts_m": rng.uniform([1, 1], [6, 4], (releases, 2)).tolist()}
    print("\n| r_n, α | code | x | pass | kJ | p | m | p | stops |\n" + "|---" * 9 + "|")
    for case, law, peer, peer_law in CASES:
        runs = {"rock2d": own_legs(GIVEN | starts | law), peer: peer_legs(peer, GIVEN | starts | peer_law)}
        stops = {code: np.minimum([path[-1, X1] for path in paths], 140.0) for code, paths in runs.items()}
        found = {code: (crossings(paths), stops[code]) for code, paths in runs.items()}
        for code, (passing, places) in found.items():
            ends = ", ".join(f"{stop:.1f}" for stop in np.percentile(places, [5, 50, 95]))
            for k in np.searchsorted(STATIONS, SHOWN):
                cells = [case, code, f"{STATIONS[k]:g} m", f"{len(passing[k])}"]
                for own, theirs in zip(found["rock2d"][0][k].T, passing[k].T, strict=True):
                    cells.append(", ".join(f"{of(theirs):.3g}" for of in SPREAD if len(theirs)))
                    cells.append(f"{ks_2samp(own, theirs).pvalue:.1g}" if min(len(own), len(theirs)) else "")
                print("|", " | ".join([*cells, ends]), "|")
        drawn |= found if law is HYPERBOLIC else {}
    return drawn


def draw(drawn, path):
    figure = blank_figure(6.4, 7.2)
    axes = figure.subplots(3, 1, sharex=True)
    axes[2].plot(*np.divide(np.transpose(PROFILE), [[1], [62]]), "#8a8578", lw=1, label="ground, of 62 m")
    for colour, (code, (passing, stops)) in zip(COLOURS, drawn.items(), strict=True):
        look = {"color": colour, "lw": 1.2} | ({"lw": 4, "alpha": 0.35} if code == "rock2d" else {})
        for j, (line, of) in product((0, 1), zip(LINESTYLES, SPREAD, strict=False)):
            values = [of(many[:, j]) if len(many) >= 40 else np.nan for many in passing]
            axes[j].plot(STATIONS, values, linestyle=line, **look)
        axes[2].plot(np.sort(stops), np.linspace(0, 1, len(stops)), label=code, **look)
    for axis, name in zip(axes, ("kinetic energy of 1 t in kJ", "height in m", "share stopped"), strict=True):
        axis.set(ylabel=name, xlim=(0, 120), ylim=(0, None))
    axes[2].set_xlabel("x in m")
    axes[2].legend(fontsize=7)
    finish(figure, "Mean (solid), 95 % (dashed) and maximum (dotted) along the slope")
    save_figure(figure, path, dpi=90)


if __name__ == "__main__":
    for name in ("PlatRock", "PyRockfall"):
        peer_legs(name, SINGLE | ELASTIC)  # refuses before anything is printed
    single_paths()
    found = ensembles()
    if len(sys.argv) > 1:
        draw(found, sys.argv[1])
