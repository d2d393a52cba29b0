"""Blind cases: set-ups, blocks, soils, cameras and incident states drawn at random, with something hidden in them.

Every case is drawn from its own child of the seed, so that case 17 of 200 is the same as case 17 of 500 in all but what
is hidden, which is dealt out so that every effect has its turn.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from rock2d.blind import reality

Array = np.ndarray

NULLS, OUTSIDERS, PAIRS = 0.22, 0.17, 0.08  # shares of all cases; the rest hide one effect
WEAKEST = 0.02  # strength of an effect, of the largest that is plausible
BLOCK_SIZE_M, BLOCK_MASS_KG = 0.02, 0.0225  # that the paper's Table 4 is for
TABLE_4 = (1.0e4, 6.0e4, 2.5e3, math.tan(math.pi / 6), 0.025)
KINDS = ("laboratory", "laboratory", "laboratory", "laboratory", "flat", "field")
RATES_HZ = (240.0, 500.0, 1000.0, 1000.0, 1000.0, 2000.0)
FEWEST, MOST = 10, 200  # releases
HELDOUT = 0.4  # further releases for the check, over those of the fit


@dataclass
class Case:
    """One case before it is filmed.

    Attributes
    ----------
    label : "none", "unknown", or the effects hidden, joined by "+"
    order : (releases,) how many releases of the same block were before; `block_ids`, `states` (releases, 6) likewise
    heldout : (releases,) mask of those kept for the check
    """

    label: str
    kind: str
    setup: reality.Setup
    law: reality.Law
    blocks: list[reality.Block]
    shapes: list[dict[str, object]]
    block_ids: Array
    states: Array
    order: Array
    heldout: Array
    gravity_m_s2: float
    fps: float
    duration_s: float
    position_noise_m: float
    angle_noise_rad: float
    colour: float
    lost: float
    soil_sd: Array
    hidden: list[reality.Hidden] = field(default_factory=list)
    seed: int = 0


def deal(count: int, seed: np.random.SeedSequence) -> list[tuple[str, ...]]:
    """What each of `count` cases hides: names of effects, of one thing outside the catalogue, or nothing."""
    rng = np.random.default_rng(seed)
    effects, outsiders = list(reality.FORMS), list(reality.OUTSIDE)
    nulls, outside, pairs = (math.ceil(share * count) for share in (NULLS, OUTSIDERS, PAIRS))
    hands: list[tuple[str, ...]] = [()] * nulls
    hands += [(name,) for name in _turns(outsiders, outside, rng)]
    hands += [tuple(rng.choice(effects, 2, replace=False)) for _ in range(pairs)]
    hands += [(name,) for name in _turns(effects, max(count - len(hands), 0), rng)]
    return [hands[i] for i in rng.permutation(len(hands))[:count]]


def _turns(names: Sequence[str], count: int, rng: np.random.Generator) -> list[str]:
    rounds = [rng.permutation(names) for _ in range(-(-count // len(names)))]
    return [str(name) for name in np.concatenate(rounds)[:count]] if rounds else []


def draw_case(hand: tuple[str, ...], seed: np.random.SeedSequence, smallest: bool = False) -> Case:
    """Draw a case that hides `hand`; `smallest` draws few releases, for tests."""
    rng = np.random.default_rng(seed)
    kind = str(rng.choice(KINDS))
    size = BLOCK_SIZE_M * rng.uniform(0.8, 1.3) * (rng.uniform(30.0, 60.0) if kind == "field" else 1.0)
    blocks, shapes = _blocks(size, rng)
    gravity = 9.81
    weight = np.mean([b.mass_kg for b in blocks]) / BLOCK_MASS_KG
    stiff = weight * BLOCK_SIZE_M / size  # stiffness in units of m g / L, rolling stiffness of m g L
    scale = np.array([stiff, stiff, stiff, 1.0, weight * size / BLOCK_SIZE_M])
    k_l, ratio, k_t, mu, k_r = scale * TABLE_4 * np.exp(rng.normal(0.0, [0.35, 0.0, 0.3, 0.2, 0.35]))
    ratio = k_l * math.exp(rng.uniform(math.log(3.0), math.log(9.0)))
    law = reality.Law(k_l, ratio, k_t, mu, k_r, indentation=bool(rng.random() < 0.7))
    setup = _flat(size, rng) if kind == "flat" else _setup(size, rng)
    pace = math.sqrt(gravity * size)
    tick = math.sqrt(size / gravity)
    releases = FEWEST if smallest else round(math.exp(rng.uniform(math.log(FEWEST), math.log(MOST))))
    if not smallest and rng.random() < 0.5:
        releases = 120
    per_block = max(2, releases // len(blocks))
    fit_and_check = per_block + math.ceil(HELDOUT * per_block)
    n = fit_and_check * len(blocks)
    block_ids = np.repeat(np.arange(len(blocks)), fit_and_check)
    order = np.tile(np.arange(fit_and_check), len(blocks))
    heldout = np.zeros(n, bool)
    for b in range(len(blocks)):
        own = np.flatnonzero(block_ids == b)
        heldout[rng.choice(own, fit_and_check - per_block, replace=False)] = True
    fps = float(rng.choice(RATES_HZ))
    if kind == "field":
        fps = float(rng.choice([120.0, 240.0, 500.0]))
    if fps * tick < 8.0:  # frames in the time that a block needs to fall half its size
        fps = 240.0 if kind == "field" else 500.0
    case = Case(
        _label(hand), kind, setup, law, blocks, shapes, block_ids, np.empty((n, 6)), order, heldout, gravity, fps,
        17.0 * tick, size * math.exp(rng.uniform(math.log(0.003), math.log(0.03))),
        math.exp(rng.uniform(math.log(0.004), math.log(0.03))), rng.uniform(0.0, 0.4), rng.uniform(0.0, 0.04),
        rng.uniform(0.0, [0.12, 0.12, 0.12, 0.08, 0.12]), seed=int(rng.integers(2**31)),
    )  # fmt: skip
    case.states = _states(case, size, pace, rng)
    for name in hand:
        form = int(rng.integers(reality.FORMS.get(name, 1)))
        strength = math.exp(rng.uniform(math.log(WEAKEST), 0.0))
        case.hidden.append(reality.draw(name, form, rng, setup, law, blocks, gravity, strength))
    return case


def _label(hand: tuple[str, ...]) -> str:
    if any(name in reality.OUTSIDE for name in hand):
        return "unknown"
    return "+".join(sorted(hand)) or "none"


def _blocks(size: float, rng: np.random.Generator) -> tuple[list[reality.Block], list[dict[str, object]]]:
    density = BLOCK_MASS_KG / BLOCK_SIZE_M**2  # per area of the profile
    if size > 0.2:
        density = 2600.0 * size
    chosen = [True, True, True]
    if rng.random() < 0.35:
        chosen = list(rng.permutation([True, False, rng.random() < 0.5]))
    out, shapes = [], []
    for name, own in zip(("sphere", "cube", "parallelepiped"), chosen, strict=True):
        if not own:
            continue
        mass = density * size**2 * rng.uniform(0.9, 1.1)
        if name == "sphere":
            diameter = 1.2 * size
            out.append(reality.Block(name, diameter / 2, None, mass, 0.4 * mass * (diameter / 2) ** 2))
            shapes.append({"shape": "circle", "diameter_m": diameter})
            continue
        length, height = (size, size) if name == "cube" else (1.7 * size, 0.7 * size)
        corners = 0.5 * np.array([[-length, -height], [length, -height], [length, height], [-length, height]])
        out.append(
            reality.Block(
                name, float(np.hypot(*corners[0])), corners, mass, mass * (length**2 + height**2) / 12
            )
        )
        shapes.append({"shape": "rectangle", "length_m": length, "height_m": height})
    return out, shapes


def _setup(size: float, rng: np.random.Generator) -> reality.Setup:
    """Slope, ditch, embankment, run-out: near the paper's, in units of the blocks' size."""
    slope, facing, back = np.deg2rad([rng.uniform(34, 45), rng.uniform(50, 72), rng.uniform(30, 45)])
    ditch, height, crest = size * np.array([rng.uniform(5, 9), rng.uniform(3, 5), rng.uniform(2, 3.5)])
    x = np.cumsum([0.0, ditch, height / math.tan(facing), crest, height / math.tan(back), 25 * size])
    y = [0.0, 0.0, height, height, 0.0, 0.0]
    points = np.vstack([[-35 * size, 35 * size * math.tan(slope)], np.column_stack([x, y])])
    zones = ("slope", "ditch", "uphill_face", "crest", "downhill_face", "run_out")
    return reality.Setup(points, zones, face=(2, 3), embankment=(2, 5), ditch=(1, 2))


def _flat(size: float, rng: np.random.Generator) -> reality.Setup:
    points = np.array([[-60.0 * size, 0.0], [60.0 * size, 0.0]])
    return reality.Setup(points, ("floor",), face=None, embankment=None, ditch=None)


def _states(case: Case, size: float, pace: float, rng: np.random.Generator) -> Array:
    """Incident states (n, 6) of the centroids, one mean state a block with jitter about it."""
    n = len(case.block_ids)
    states = np.empty((n, 6))
    for b in range(len(case.blocks)):
        own = case.block_ids == b
        k = int(own.sum())
        states[own, 0] = size * (rng.uniform(-0.5, 1.5) + rng.normal(0.0, 0.6, k))
        states[own, 1] = size * (5.0 + rng.normal(0.0, 0.4, k))
        states[own, 2] = rng.uniform(-math.pi, math.pi, k)
        states[own, 3] = pace * (rng.uniform(1.8, 3.2) + rng.normal(0.0, 0.5, k))
        states[own, 4] = -pace * (rng.uniform(3.5, 5.0) + rng.normal(0.0, 0.5, k))
        states[own, 5] = pace / size * (rng.uniform(-2.0, 1.0) + rng.normal(0.0, 0.8, k))
    if case.kind == "flat":
        states[:, 0] -= 15.0 * size
    # above the slope, too: nobody lets a block go inside the ground
    x = case.setup.points_m
    ground = np.interp(states[:, 0], x[:, 0], x[:, 1])
    states[:, 1] = np.maximum(states[:, 1], ground + 2.5 * size)
    return states
