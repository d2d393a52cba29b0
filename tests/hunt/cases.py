"""Random releases: cross-sections, soils, blocks and starts over the whole range that a scenario may ask for."""

import json
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from rock2d.laws.contact import ContactParameters
from rock2d.scene.blocks import Block, make_block
from rock2d.scene.cross_section import CrossSection, CrossSectionError

Array = np.ndarray

GRAVITY_M_S2 = 9.81
SHAPES = ("circle", "ellipse", "square", "rectangle", "polygon")
ROCK_KG_M2 = 2700.0  # mass per area of a slice one metre thick
STATE = ("x_m", "y_m", "theta_rad", "vx_m_s", "vy_m_s", "omega_rad_s")
TIME_LIMIT = 250.0  # time limit of a release, in √(radius / g)


@dataclass(frozen=True)
class Site:
    """A block on a cross-section with its soils: what several releases share.

    `sizes` and `soils` are what a scenario file says of the block and of each zone."""

    block: Block
    sizes: dict[str, Any]
    cross_section: CrossSection
    soils: dict[str, ContactParameters]

    @property
    def time_limit_s(self) -> float:
        """Time limit of its releases."""
        return float(TIME_LIMIT * np.sqrt(self.block.radius_m / GRAVITY_M_S2))


@dataclass(frozen=True)
class Case:
    """One release on a site; `state` (6,) of the centre of mass in SI."""

    site: Site
    state: Array

    def scenario(self, name: str, what: str) -> str:
        """The text of a scenario file that repeats the release; `what` happens becomes its first line."""
        site, block = self.site, self.site.block
        ground = site.cross_section
        soils = {zone: vars(law) for zone, law in site.soils.items()}
        data = {
            "name": name,
            "gravity_m_s2": GRAVITY_M_S2,
            "engine": "batch",
            "releases": 1,
            "seed": 1,
            "time_limit_s": site.time_limit_s,
            "cross_section": {"points_m": ground.points_m.tolist(), "zones": list(ground.zones)},
            "blocks": {
                "rock": {
                    "shape": block.shape, **site.sizes, "mass_kg": block.mass_kg, "inertia": block.inertia_kg_m2,
                }
            },
            "model": {"deterministic": {"default": next(iter(soils.values())), **soils}},
            "incident": {"default": {"fixed": dict(zip(STATE, self.state.tolist(), strict=True))}},
        }  # fmt: skip
        return f"# {what}\n{json.dumps(data, indent=1)}\n"  # JSON is YAML


def random_site(rng: np.random.Generator, shape: str | None = None) -> Site:
    """A random site; its lengths go from pebbles in a flume to boulders on a slope."""
    radius = float(np.exp(rng.uniform(np.log(0.01), np.log(1.5))))
    block, sizes = _block(rng, shape or str(rng.choice(SHAPES)), radius)
    while True:
        try:
            ground = _ground(rng, radius)
            break
        except CrossSectionError:
            continue  # random points may cross each other
    speed = np.sqrt(2.0 * GRAVITY_M_S2 * 6.0 * radius)
    soils = {zone: _soil(rng, block, speed) for zone in ground.zone_names}
    return Site(block, sizes, ground, soils)


def random_states(rng: np.random.Generator, site: Site, count: int) -> Array:
    """(count, 6) starts clear of the ground, in flight."""
    ground, r = site.cross_section, site.block.reach_m
    x0, x1 = ground.points_m[0, 0], ground.points_m[-1, 0]
    x = rng.uniform(x0 + 0.02 * (x1 - x0), x1 - 0.02 * (x1 - x0), count)
    if rng.random() < 0.5:  # near a vertex: corners are where geometry is hard
        x = ground.points_m[rng.integers(0, len(ground.points_m), count), 0] + rng.normal(0.0, r, count)
        x = np.clip(x, x0, x1)
    top = np.array([_highest(ground, a - 1.05 * r, a + 1.05 * r) for a in x])
    speed = np.exp(rng.uniform(np.log(0.1), np.log(6.0), count)) * np.sqrt(GRAVITY_M_S2 * r)
    angle = rng.uniform(-np.pi, 0.3 * np.pi, count)
    spin = rng.normal(0.0, 3.0, count) * np.sqrt(GRAVITY_M_S2 / r) * rng.choice([0.0, 1.0, 3.0], count)
    y = top + r * (1.1 + rng.exponential(3.0, count))
    return np.column_stack(
        [x, y, rng.uniform(-np.pi, np.pi, count), speed * np.cos(angle), speed * np.sin(angle), spin]
    )


def _highest(ground: CrossSection, low: float, high: float) -> float:
    """Greatest height of the ground in an interval of x."""
    inside = ground.points_m[(ground.points_m[:, 0] >= low) & (ground.points_m[:, 0] <= high), 1]
    ends = np.clip([low, high], ground.points_m[0, 0], ground.points_m[-1, 0])
    return float(max([*inside, *ground.height_m(ends)]))


def _block(rng: np.random.Generator, shape: str, radius: float) -> tuple[Block, dict[str, Any]]:
    ratio = float(rng.uniform(0.3, 1.0))
    sizes: dict[str, Any]
    if shape == "circle":
        sizes = {"diameter_m": 2.0 * radius}
    elif shape == "square":
        sizes = {"side_m": radius * np.sqrt(2.0)}
    elif shape == "polygon":
        sizes = {"vertices_m": _convex(rng, radius).tolist()}
    else:
        sizes = {"length_m": 2.0 * radius, "height_m": 2.0 * radius * ratio}
    area = make_block("rock", shape, 1.0, "uniform", **sizes).area_m2
    mass = float(ROCK_KG_M2 * area * min(1.0, 2.0 * radius))
    block = make_block("rock", shape, mass, "uniform", **sizes)
    if shape != "polygon":
        return block, sizes
    return block, {"vertices_m": block.corners_m.tolist()}


def _convex(rng: np.random.Generator, radius: float) -> Array:
    """(3 to 8, 2) corners on an ellipse: a convex polygon."""
    while True:
        n = int(rng.integers(3, 9))
        angle = np.sort(rng.uniform(0.0, 2 * np.pi, n))
        gaps = np.diff(np.append(angle, angle[0] + 2 * np.pi))
        if gaps.min() > 0.15 and gaps.max() < 0.95 * np.pi:
            stretch = rng.uniform(0.4, 1.0)
            return radius * np.column_stack([np.cos(angle), stretch * np.sin(angle)])


def _ground(rng: np.random.Generator, radius: float) -> CrossSection:
    """A slope, a ditch, an embankment or wall, a back slope: rough, divided, narrow, vertical or overhanging."""
    u = radius * float(np.exp(rng.uniform(np.log(0.5), np.log(4.0))))  # the unit of the ground's lengths
    slope = [(0.0, 0.0)]
    for _ in range(int(rng.integers(1, 5))):
        x, y = slope[-1]
        run = u * rng.uniform(1.0, 8.0)
        slope.append((x + run, y - run * np.tan(rng.uniform(-0.2, 1.2))))
    for _ in range(int(rng.integers(0, 3))):  # ditch or terrace
        x, y = slope[-1]
        slope.append((x + u * rng.uniform(0.3, 8.0), y + u * rng.normal(0.0, 0.2)))
    for _ in range(int(rng.integers(0, 3))):  # embankments, walls, spikes, steps
        x, y = slope[-1]
        height = u * rng.uniform(0.2, 3.0)
        lean = rng.choice([0.0, 0.0, rng.uniform(0.0, 1.0), -rng.uniform(0.0, 0.3)]) * height
        crest = u * float(np.exp(rng.uniform(np.log(0.02), np.log(4.0))))
        slope += [(x + lean, y + height), (x + lean + crest, y + height + u * rng.normal(0.0, 0.05))]
        back = rng.choice([0.0, rng.uniform(0.0, 2.0)]) * height
        slope.append((x + lean + crest + back, y + rng.uniform(-1.0, 0.6) * height))
        x, y = slope[-1]
        slope.append((x + u * rng.uniform(0.3, 6.0), y - u * rng.uniform(0.0, 0.4)))
    x, y = slope[-1]
    slope.append((x + u * rng.uniform(2.0, 20.0), y - u * rng.uniform(0.0, 4.0)))
    points = _divided(rng, np.array(slope), u)
    names = [f"z{k}" for k in range(int(rng.integers(1, 5)))]
    return CrossSection(points, [str(z) for z in rng.choice(names, len(points) - 1)])


def _divided(rng: np.random.Generator, points: Array, u: float) -> Array:
    """The polyline with some of its facets divided and roughened."""
    pieces = int(rng.choice([1, 1, 1, 2, 4, 12]))
    rough = rng.choice([0.0, 0.0, 0.002, 0.02, 0.1]) * u
    out = [points[:1]]
    for a, b in pairwise(points):
        part = a + (b - a) * np.arange(1, pieces + 1)[:, None] / pieces
        if pieces > 1:
            part[:-1] += rng.normal(0.0, rough, (pieces - 1, 2)) * [0.2, 1.0]
        out.append(part)
    return np.concatenate(out)


def _soil(rng: np.random.Generator, block: Block, speed: float) -> ContactParameters:
    """Soil from hard to so soft that a block sinks in by its own size."""
    depth = block.radius_m * float(np.exp(rng.uniform(np.log(0.002), np.log(0.4 if rng.random() < 0.85 else 2.0))))
    k_l = block.mass_kg * speed**2 / depth**2
    k_ul = k_l * float(rng.choice([1.0, np.exp(rng.uniform(0.0, np.log(40.0)))], p=[0.1, 0.9]))
    k_t = k_l * float(rng.choice([0.0, 0.25, rng.uniform(0.05, 1.2)]))
    k_r = k_l * block.radius_m**2 * float(rng.choice([0.0, 0.0, np.exp(rng.uniform(np.log(1e-3), np.log(0.3)))]))
    phi = float(rng.choice([rng.uniform(5.0, 60.0), 0.0, 90.0], p=[0.9, 0.05, 0.05]))
    cap, indentation = (bool(rng.random() < 0.4) for _ in range(2))
    return ContactParameters(k_l, k_ul, k_t, phi, k_r, cap, indentation)
