"""Blind cases: random set-ups, blocks, soils, cameras and incident states, with hidden causes.

Every case has its own child of the seed, so that case 17 of 200 equals case 17 of 500 except for its causes. These are
assigned so that all effects occur equally often."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rock2d.arrays import Array
from rock2d.blind import reality

# Shares of all cases. A cause from outside the catalogue acts alone in half of its cases, and together with one or two
# effects in the others. The remaining cases hide one effect.
SHARE_WITHOUT_CAUSE, SHARE_OUTSIDE = 0.2, 0.2
SHARE_OF_COUNT = {2: 0.18, 3: 0.11, 4: 0.07}  # number of effects -> share
LEAST_STRENGTH = 0.02  # smallest strength of a cause, as a share of the largest plausible one
# block size and mass of the paper's experiment, and its Table 4: k_l, k_ul, k_t, friction coefficient, k_r
PAPER_BLOCK_SIZE_M, PAPER_BLOCK_MASS_KG = 0.02, 0.0225
PAPER_LAW = (1.0e4, 6.0e4, 2.5e3, math.tan(math.pi / 6), 0.025)
KINDS = ("laboratory", "laboratory", "laboratory", "laboratory", "flat", "field")
FRAME_RATES_HZ = (240.0, 500.0, 1000.0, 1000.0, 1000.0, 2000.0)
FIELD_FRAME_RATES_HZ = (120.0, 240.0, 500.0)
FEWEST_FRAMES_PER_FALL = 8.0  # frames in √(size / g)
FEWEST_CASE_RELEASES, MOST_CASE_RELEASES, USUAL_RELEASES = 10, 200, 60
# Held-out releases over those of the fit. As many: the ground ages alike in both series, and what a prediction misses
# is known as well as what the diagnosis claims of it.
HELDOUT_SHARE = 1.0
FILM_LENGTH = 17.0  # √(size / g)
GRAVITY_M_S2 = 9.81


@dataclass
class Case:
    """One case before it is filmed.

    Attributes
    ----------
    shapes : shape of each block, as the experiment file states it
    kind : one of KINDS
    heldout : (releases,) mask of the held-out releases
    hidden : the hidden causes
    soil_sd : (5,) scatter of the soil, see `reality.simulate_poses`"""

    kind: str
    world: reality.World
    shapes: list[dict[str, object]]
    releases: reality.Releases
    heldout: Array
    fps: float
    duration_s: float
    camera: reality.Camera
    soil_sd: Array
    hidden: list[reality.Hidden] = field(default_factory=list)
    seed: int = 0

    @property
    def label(self) -> str:
        """ "none", or the hidden effects, and "unknown" for a cause outside the catalogue, joined by "+"."""
        known = sorted(cause.name for cause in self.hidden if cause.name not in reality.OUTSIDE)
        return "+".join([*known, *["unknown"] * (len(known) < len(self.hidden))]) or "none"

    @property
    def times_s(self) -> Array:
        """The stated instants of the frames."""
        return np.arange(int(self.duration_s * self.fps)) / self.fps

    def filmed(
        self, times_s: Array, hidden: list[reality.Hidden], *, noisy: bool, soil_sd: Array | None = None
    ) -> Array:
        """(releases, frames, 3) poses that the camera records while the causes `hidden` act."""
        poses = reality.simulate_poses(
            self.world, self.releases, times_s, soil_sd=self.soil_sd if soil_sd is None else soil_sd, hidden=hidden,
            seed=self.seed,
        )  # fmt: skip
        camera = self.camera if noisy else replace(self.camera, position_noise_m=0.0, angle_noise_rad=0.0, lost=0.0)
        return reality.record_poses(poses, times_s, camera, hidden, self.seed + 1)


def assign_causes(count: int, seed: np.random.SeedSequence) -> list[tuple[str, ...]]:
    """Names of the hidden causes of each of `count` cases: up to four effects, or an outside cause with up to two
    effects, or none."""
    rng = np.random.default_rng(seed)
    outside = _in_rounds(list(reality.OUTSIDE), math.ceil(SHARE_OUTSIDE * count), rng)
    effects_with_outside = [0 if i % 2 == 0 else 1 + (i // 2) % 2 for i in range(len(outside))]
    several = [n for n, share in SHARE_OF_COUNT.items() for _ in range(math.ceil(share * count))]
    count_without = math.ceil(SHARE_WITHOUT_CAUSE * count)
    single = [1] * max(count - count_without - len(outside) - len(several), 0)
    sizes = [*effects_with_outside, *several, *single]
    effects = _groups(sizes, rng)
    causes = [(*own, name) for own, name in zip(effects, outside, strict=False)]
    causes += [*effects[len(outside) :], *[()] * count_without]
    return [causes[i] for i in rng.permutation(len(causes))[:count]]


def _groups(sizes: Sequence[int], rng: np.random.Generator) -> list[tuple[str, ...]]:
    """Groups of different effects with these sizes; all effects occur equally often over all groups."""
    queue = _in_rounds(list(reality.FORMS), 2 * sum(sizes), rng)
    groups = []
    for size in sizes:
        group: list[str] = []
        while len(group) < size:
            group.append(queue.pop(next(i for i, name in enumerate(queue) if name not in group)))
        groups.append(tuple(group))
    return groups


def _in_rounds(names: Sequence[str], count: int, rng: np.random.Generator) -> list[str]:
    """`count` names in rounds; each round has every name once, in random order."""
    rounds = [rng.permutation(names) for _ in range(-(-count // len(names)))]
    return [str(name) for name in np.concatenate(rounds)[:count]] if rounds else []


def draw_case(causes: tuple[str, ...], seed: np.random.SeedSequence, smallest: bool = False) -> Case:
    """Draw a case that hides `causes`; `smallest` draws few releases, for tests."""
    rng = np.random.default_rng(seed)
    kind = str(rng.choice(KINDS))
    size = PAPER_BLOCK_SIZE_M * rng.uniform(0.8, 1.3) * (rng.uniform(30.0, 60.0) if kind == "field" else 1.0)
    blocks, shapes = _blocks(size, rng)
    law = _law(size, blocks, rng)
    setup = _floor_setup(size, rng) if kind == "flat" else _embankment_setup(size, rng)
    world = reality.World(setup, law, blocks, GRAVITY_M_S2)
    block_ids, order, heldout = _releases(len(blocks), smallest, rng)
    time_scale = math.sqrt(size / GRAVITY_M_S2)
    fps = _frame_rate(kind, time_scale, rng)
    camera = _camera(setup, size, rng)
    soil_sd = rng.uniform(0.0, [0.12, 0.12, 0.12, 0.08, 0.12])
    case_seed = int(rng.integers(2**31))
    states = _states(block_ids, world, size, kind, rng)
    releases = reality.Releases(block_ids, states, order)
    hidden = []
    for name in causes:
        form = int(rng.integers(reality.FORMS.get(name, 1)))
        strength = math.exp(rng.uniform(math.log(LEAST_STRENGTH), 0.0))
        hidden.append(reality.draw_hidden(name, form, rng, world, strength))
    return Case(
        kind, world, shapes, releases, heldout, fps, FILM_LENGTH * time_scale, camera, soil_sd,
        hidden, case_seed,
    )  # fmt: skip


def _law(size: float, blocks: Sequence[reality.Block], rng: np.random.Generator) -> reality.Law:
    """The paper's law, scaled to blocks of this size and mass, with random factors."""
    weight = np.mean([b.mass_kg for b in blocks]) / PAPER_BLOCK_MASS_KG
    stiff = weight * PAPER_BLOCK_SIZE_M / size  # stiffness in units of m g / L, rolling stiffness of m g L
    scale = np.array([stiff, stiff, stiff, 1.0, weight * size / PAPER_BLOCK_SIZE_M])
    k_l, _, k_t, mu, k_r = scale * PAPER_LAW * np.exp(rng.normal(0.0, [0.35, 0.0, 0.3, 0.2, 0.35]))
    k_ul = k_l * math.exp(rng.uniform(math.log(3.0), math.log(9.0)))
    return reality.Law(k_l, k_ul, k_t, mu, k_r, indentation=bool(rng.random() < 0.7))


def _releases(n_blocks: int, smallest: bool, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Block, number of earlier releases of the same block, and whether held out, of each release.

    The film for the diagnosis and the held-out film are separate series: the ground is renewed for each block of each
    film. A file numbers its releases from 0, so earlier releases in another file would be unknown."""
    releases = FEWEST_CASE_RELEASES
    if not smallest:
        releases = round(math.exp(rng.uniform(math.log(FEWEST_CASE_RELEASES), math.log(MOST_CASE_RELEASES))))
        if rng.random() < 0.5:
            releases = USUAL_RELEASES
    per_block = max(2, releases // n_blocks)
    fit_and_heldout = per_block + math.ceil(HELDOUT_SHARE * per_block)
    block_ids = np.repeat(np.arange(n_blocks), fit_and_heldout)
    heldout, order = np.zeros(len(block_ids), bool), np.empty(len(block_ids), int)
    for b in range(n_blocks):
        releases_of_block = np.flatnonzero(block_ids == b)
        heldout[rng.choice(releases_of_block, fit_and_heldout - per_block, replace=False)] = True
        for series in (releases_of_block[heldout[releases_of_block]], releases_of_block[~heldout[releases_of_block]]):
            order[series] = np.arange(len(series))
    return block_ids, order, heldout


def _frame_rate(kind: str, time_scale: float, rng: np.random.Generator) -> float:
    fps = float(rng.choice(FRAME_RATES_HZ))
    if kind == "field":
        fps = float(rng.choice(FIELD_FRAME_RATES_HZ))
    if fps * time_scale < FEWEST_FRAMES_PER_FALL:
        fps = 240.0 if kind == "field" else 500.0
    return fps


def _camera(setup: reality.Setup, size: float, rng: np.random.Generator) -> reality.Camera:
    position_noise_m = size * math.exp(rng.uniform(math.log(0.003), math.log(0.03)))
    angle_noise_rad = math.exp(rng.uniform(math.log(0.004), math.log(0.03)))
    noise_correlation, lost = rng.uniform(0.0, 0.4), rng.uniform(0.0, 0.04)
    points = setup.points_m
    x = points[1:, 0] if len(points) > 2 else points[:, 0] / 3
    extent = float(np.ptp(x))
    return reality.Camera(
        position_noise_m, angle_noise_rad, noise_correlation, lost, np.array([x.mean(), 0.2 * extent]), extent
    )


def _blocks(size: float, rng: np.random.Generator) -> tuple[list[reality.Block], list[dict[str, object]]]:
    density = PAPER_BLOCK_MASS_KG / PAPER_BLOCK_SIZE_M**2  # per area of the profile
    if size > 0.2:
        density = 2600.0 * size
    chosen = [True, True, True]
    if rng.random() < 0.35:
        chosen = list(rng.permutation([True, False, rng.random() < 0.5]))
    out, shapes = [], []
    for name, included in zip(("sphere", "cube", "parallelepiped"), chosen, strict=True):
        if not included:
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
            reality.Block(name, float(np.hypot(*corners[0])), corners, mass, mass * (length**2 + height**2) / 12)
        )
        shapes.append({"shape": "rectangle", "length_m": length, "height_m": height})
    return out, shapes


def _embankment_setup(size: float, rng: np.random.Generator) -> reality.Setup:
    """Slope, ditch, embankment and run-out as in the paper, with random sizes in units of the block size."""
    slope, facing, back = np.deg2rad([rng.uniform(34, 45), rng.uniform(50, 72), rng.uniform(30, 45)])
    ditch, height, crest = size * np.array([rng.uniform(5, 9), rng.uniform(3, 5), rng.uniform(2, 3.5)])
    x = np.cumsum([0.0, ditch, height / math.tan(facing), crest, height / math.tan(back), 25 * size])
    y = [0.0, 0.0, height, height, 0.0, 0.0]
    points = np.vstack([[-35 * size, 35 * size * math.tan(slope)], np.column_stack([x, y])])
    zones = ("slope", "ditch", "uphill_face", "crest", "downhill_face", "run_out")
    return reality.Setup(points, zones, face=(2, 3), embankment=(2, 5), ditch=(1, 2))


def _floor_setup(size: float, rng: np.random.Generator) -> reality.Setup:
    points = np.array([[-60.0 * size, 0.0], [60.0 * size, 0.0]])
    return reality.Setup(points, ("floor",), face=None, embankment=None, ditch=None)


def _states(block_ids: Array, world: reality.World, size: float, kind: str, rng: np.random.Generator) -> Array:
    """Incident states (n, 6) of the centroids: one mean state for each block, with scatter about it."""
    pace = math.sqrt(world.gravity_m_s2 * size)
    states = np.empty((len(block_ids), 6))
    for b in range(len(world.blocks)):
        rows = block_ids == b
        k = int(rows.sum())
        states[rows, 0] = size * (rng.uniform(-0.5, 1.5) + rng.normal(0.0, 0.6, k))
        states[rows, 1] = size * (5.0 + rng.normal(0.0, 0.4, k))
        states[rows, 2] = rng.uniform(-math.pi, math.pi, k)
        states[rows, 3] = pace * (rng.uniform(1.8, 3.2) + rng.normal(0.0, 0.5, k))
        states[rows, 4] = -pace * (rng.uniform(3.5, 5.0) + rng.normal(0.0, 0.5, k))
        states[rows, 5] = pace / size * (rng.uniform(-2.0, 1.0) + rng.normal(0.0, 0.8, k))
    if kind == "flat":
        states[:, 0] -= 15.0 * size
    # releases must start above the ground, on the slope, too
    points = world.setup.points_m
    ground = np.interp(states[:, 0], points[:, 0], points[:, 1])
    states[:, 1] = np.maximum(states[:, 1], ground + 2.5 * size)
    return states
