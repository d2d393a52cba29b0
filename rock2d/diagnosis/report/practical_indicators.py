"""The gap in the terms of a practitioner: passing frequencies, energies, bounce heights and runout, measured and
simulated.

Simulated films have the camera's instants and noise and are evaluated in the same way as the measured film. An impact
table has no flights between impacts, so only the energy after each impact is compared."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rock2d.arrays import Array
from rock2d.diagnosis.data import TableData
from rock2d.diagnosis.replay import Releases
from rock2d.files.experiment import Experiment
from rock2d.graphics.pages import Download, download
from rock2d.kinematics.impacts import SPIN_AFTER, VELOCITY_AFTER, ground_axes
from rock2d.runs.indicators.crossings import CROSSING_COLUMNS, crossing_values
from rock2d.scene.blocks import Block
from rock2d.statistics import wilson_interval

PASSING = "Passing frequency"
COMPARED_PERCENTILES = (50.0, 75.0, 95.0)
FEWEST_VALUES = 8  # for a percentile
ENERGY_UNITS = ((1e6, "MJ"), (1e3, "kJ"), (1.0, "J"), (1e-3, "mJ"))
LENGTH_UNITS = ((1.0, "m"), (1e-3, "mm"))
INDICATOR_BOOTSTRAPS = 400
VELOCITY_WINDOW = 0.15  # half the time over which a velocity is fitted, in √(radius / g)
ENERGY = CROSSING_COLUMNS.index("kinetic_J") - CROSSING_COLUMNS.index("t_s")  # column of `crossing_values`


@dataclass(frozen=True)
class CountedEstimate:
    """A number with its 95 % interval, from `count` values."""

    value: float
    low: float
    high: float
    count: int


@dataclass(frozen=True)
class Row:
    """A quantity of a block at a line or place; `models`: model -> estimates (one, or one for each percentile)."""

    block: str
    place: str
    models: dict[str, list[CountedEstimate]]


@dataclass(frozen=True)
class Quantity:
    """A quantity with all its rows; `percentiles` is empty for a frequency."""

    title: str
    unit: str
    rows: list[Row]
    percentiles: tuple[float, ...] = COMPARED_PERCENTILES


def quantity_data(quantity: Quantity, labels: Mapping[str, str]) -> Download:
    """The numbers of a quantity as CSV; `labels`: model -> its name."""
    rows = [
        (row.block, row.place, labels[model], percentile, e.value, e.low, e.high, e.count)
        for row in quantity.rows
        for model, own in row.models.items()
        for percentile, e in zip(quantity.percentiles or (None,), own, strict=False)  # few values: no estimates
    ]
    value = f"value ({quantity.unit})"
    columns = ("block", "place", "model", "percentile", value, "low95", "high95", "count")
    return download(f"{quantity.title.lower().replace(' ', '_')}.csv", columns, rows)


def measure_lines(experiment: Experiment, top_m: float) -> tuple[dict[str, Array], str]:
    """The experiment's measure lines, or three vertical lines on the uphill facing; and a note on the assumption."""
    cross_section = experiment.cross_section
    if cross_section.measure_lines:
        return dict(cross_section.measure_lines), ""
    rise = cross_section.embankment
    if rise is None:
        return {}, ""
    facing = cross_section.points_m[rise.left : rise.crest + 1]
    lines = {}
    for name, share in (("1/3 of the facing", 1 / 3), ("2/3 of the facing", 2 / 3), ("crest", 1.0)):
        height = facing[0, 1] + share * (facing[-1, 1] - facing[0, 1])
        i = int(np.argmax(facing[1:, 1] >= height - 1e-12 * abs(height)))
        (x0, y0), (x1, y1) = facing[i], facing[i + 1]
        x = x0 + (height - y0) / (y1 - y0) * (x1 - x0)
        lines[name] = np.array([[x, height], [x, max(top_m, height) + rise.height_m]])
    return lines, (
        "The experiment states no measure lines. The lines used here are vertical. Their feet lie on the uphill "
        "facing, at 1/3 and 2/3 of its height and at the crest."
    )


def film_quantities(
    experiment: Experiment, film: Releases, models: Mapping[str, Array], lines: Mapping[str, Array]
) -> list[Quantity]:
    """Quantities of releases; `models`: name -> poses (repetitions, n, k, 3) at the instants of `film`."""
    rng = np.random.default_rng(0)
    blocks = list(experiment.blocks.values())
    kinds = [b for b in range(len(blocks)) if (film.block == b).any()]
    found = {name: _release_values(experiment, film, poses, lines) for name, poses in models.items()}

    def rows(key: str, place: str, as_frequency: bool = False) -> list[Row]:
        out = []
        for b in kinds:
            own = film.block == b
            row = {
                m: _frequency(v[key][:, own], rng) if as_frequency else _percentiles(v[key][:, own], rng)
                for m, v in found.items()
            }
            out.append(Row(blocks[b].name, place, row))
        return out

    def by_block(parts: Sequence[list[Row]]) -> list[Row]:
        return [row for own in zip(*parts, strict=True) for row in own]

    quantities = []
    if lines:
        passing = by_block([rows(f"energy {name}", name, as_frequency=True) for name in lines])
        quantities.append(Quantity(PASSING, "%", passing, ()))
        energy = by_block([rows(f"energy {name}", name) for name in lines])
        quantities.append(Quantity("Kinetic energy at the lines", *_rescaled(energy, ENERGY_UNITS)))
    else:
        energy = rows("energy aloft", "")
        quantities.append(Quantity("Kinetic energy at the top of the highest bounce", *_rescaled(energy, ENERGY_UNITS)))
    quantities.append(Quantity("Bounce height", *_rescaled(rows("bounce", ""), LENGTH_UNITS)))
    quantities.append(Quantity("Runout", *_rescaled(rows("runout", ""), LENGTH_UNITS)))
    return [q for q in quantities if any(estimates for row in q.rows for estimates in row.models.values())]


def table_quantities(experiment: Experiment, data: TableData, models: Mapping[str, Array]) -> list[Quantity]:
    """The energy after each impact; `models`: name -> residuals (n, 3) of the velocities along and across the ground
    and of the spin, simulated minus measured."""
    rng = np.random.default_rng(0)
    blocks = list(experiment.blocks.values())
    after = data.after
    measured = np.column_stack([*ground_axes(data.tangent, after[:, VELOCITY_AFTER]), after[:, SPIN_AFTER]])
    rows = []
    for b, block in enumerate(blocks):
        own = data.impact_block == b
        row = {}
        for name, own_residuals in {"measured": np.zeros_like(measured), **models}.items():
            v = measured[own] + own_residuals[own]
            energy = (
                0.5 * block.mass_kg * (v[:, VELOCITY_AFTER] ** 2).sum(axis=1)
                + 0.5 * block.inertia_kg_m2 * v[:, SPIN_AFTER] ** 2
            )
            row[name] = _percentiles(energy[None], rng)
        if own.any():
            rows.append(Row(block.name, "", row))
    return [Quantity("Kinetic energy after an impact", *_rescaled(rows, ENERGY_UNITS))]


def _release_values(
    experiment: Experiment, film: Releases, poses: Array, lines: Mapping[str, Array]
) -> dict[str, Array]:
    """Quantity -> values (repetitions, n); NaN where a release has none."""
    blocks = list(experiment.blocks.values())
    repetitions, n, k, _ = poses.shape
    flat, t = poses.reshape(-1, k, 3), np.tile(film.t_s, (repetitions, 1))
    block = np.tile(film.block, repetitions)
    masses = np.array([(b.mass_kg, b.inertia_kg_m2) for b in blocks])[block]
    out = {}
    windows = [_half_window(experiment, b, film.t_s) for b in blocks]
    half = np.array(windows)[block]
    for name, line in lines.items():
        crossings = _crossings(t, flat, line, half)
        energy = np.full(len(flat), np.nan)
        own = np.isfinite(crossings[:, 0])
        energy[own] = crossing_values(crossings[own], line, experiment.cross_section, masses[own])[:, ENERGY]
        out[f"energy {name}"] = energy
    height = flat[..., 1] - experiment.cross_section.height_m(flat[..., 0])
    later = np.arange(k) >= np.tile(film.impact, repetitions)[:, None]
    height = np.where(later & np.isfinite(height), height, -np.inf)
    top = height.argmax(axis=1)
    rows = np.arange(len(flat))
    out["bounce"] = np.where(np.isfinite(height[rows, top]), height[rows, top], np.nan)
    if not lines:
        pace = _velocities(t, flat, top, half)
        energy = 0.5 * masses[:, 0] * (pace[:, :2] ** 2).sum(axis=1) + 0.5 * masses[:, 1] * pace[:, 2] ** 2
        out["energy aloft"] = np.where(np.isfinite(out["bounce"]), energy, np.nan)
    last = np.isfinite(t).sum(axis=1) - 1
    out["runout"] = np.abs(flat[rows, last, 0] - flat[rows, 0, 0])
    return {name: values.reshape(repetitions, n) for name, values in out.items()}


def _half_window(experiment: Experiment, block: Block, t_s: Array) -> int:
    """Frames on either side over which a velocity is fitted."""
    frame_s = float(np.nanmedian(np.diff(t_s, axis=1)))
    half_s = VELOCITY_WINDOW * np.sqrt(block.radius_m / max(experiment.gravity_m_s2, 1e-3))
    return int(np.clip(round(half_s / frame_s), 2, 20))


def _crossings(t: Array, pose: Array, line: Array, half: Array) -> Array:
    """(n, 7) instant and state at the first crossing of a line by each release; NaN without a crossing."""
    origin, along = line[0], line[1] - line[0]
    away = pose[..., :2] - origin
    side = away[..., 1] * along[0] - away[..., 0] * along[1]
    a, b = side[:, :-1], side[:, 1:]
    change = (a < 0) != (b < 0)
    share = np.divide(a, a - b, out=np.zeros_like(a), where=change & np.isfinite(a) & np.isfinite(b))
    at = ((away[:, :-1] + share[..., None] * np.diff(away, axis=1)) @ along) / (along @ along)
    hit = change & np.isfinite(a) & np.isfinite(b) & (at >= 0.0) & (at <= 1.0)
    out = np.full((len(t), 7), np.nan)
    own = np.flatnonzero(hit.any(axis=1))
    i = hit[own].argmax(axis=1)
    s = share[own, i]
    out[own, 0] = t[own, i] + s * (t[own, i + 1] - t[own, i])
    out[own, 1:4] = pose[own, i] + s[:, None] * (pose[own, i + 1] - pose[own, i])
    out[own, 4:] = _velocities(t[own], pose[own], i, half[own])
    return out


def _velocities(t: Array, pose: Array, at: Array, half: Array) -> Array:
    """(n, 3) velocities at frame `at` (n,), from lines fitted to `half` (n,) frames on either side."""
    widest = int(half.max(initial=2))
    frames = at[:, None] + np.arange(-widest, widest + 1)
    rows = np.arange(len(t))[:, None]
    inside = (frames >= 0) & (frames < t.shape[1]) & (np.abs(frames - at[:, None]) <= half[:, None])
    frames = np.clip(frames, 0, t.shape[1] - 1)
    use = inside & np.isfinite(t[rows, frames])
    weight = use / np.maximum(use.sum(axis=1, keepdims=True), 1)
    instants = np.where(use, t[rows, frames], 0.0)
    centred = np.where(use, instants - (weight * instants).sum(axis=1, keepdims=True), 0.0)
    values = np.where(use[..., None], pose[rows, frames], 0.0)
    return np.einsum("nf,nfc->nc", centred, values) / np.maximum((centred**2).sum(axis=1), 1e-30)[:, None]


def _frequency(values: Array, rng: np.random.Generator) -> list[CountedEstimate]:
    """Share in % of the releases that have a value, with Wilson's interval.

    Repetitions are not independent releases, so with several of them the interval is at least that of a bootstrap."""
    passed = np.isfinite(values)
    n = passed.shape[1]
    low, high = wilson_interval(int(passed.sum()), passed.size)
    if len(values) > 1:
        draws = passed.mean(axis=0)[rng.integers(0, n, (INDICATOR_BOOTSTRAPS, n))].mean(axis=1)
        low, high = min(low, float(np.quantile(draws, 0.025))), max(high, float(np.quantile(draws, 0.975)))
    return [CountedEstimate(100 * float(passed.mean()), 100 * low, 100 * high, int(passed.sum()))]


def _percentiles(values: Array, rng: np.random.Generator) -> list[CountedEstimate]:
    """Percentiles of values (repetitions, n) with bootstrap intervals over releases; empty for too few releases."""
    count = int(np.isfinite(values).any(axis=0).sum())
    if count < FEWEST_VALUES:
        return []
    n = values.shape[1]
    drawn = values[:, rng.integers(0, n, (INDICATOR_BOOTSTRAPS, n))]
    draws = drawn.transpose(1, 0, 2).reshape(INDICATOR_BOOTSTRAPS, -1)
    spread = _quantiles(np.sort(draws, axis=1))
    middle = _quantiles(np.sort(values.reshape(1, -1), axis=1))[0]
    low, high = np.nanquantile(spread, [0.025, 0.975], axis=0)
    bounds = zip(middle, low, high, strict=True)
    return [CountedEstimate(float(v), float(a), float(b), count) for v, a, b in bounds]


def _quantiles(ranked: Array) -> Array:
    """(m, percentiles) percentiles of rows sorted with NaN last, by linear interpolation as in numpy; NaN for an empty
    row."""
    last = np.isfinite(ranked).sum(axis=1) - 1
    at = np.maximum(last, 0)[:, None] * (np.array(COMPARED_PERCENTILES) / 100.0)
    below = at.astype(int)
    rows = np.arange(len(ranked))[:, None]
    a, b = ranked[rows, below], ranked[rows, np.minimum(below + 1, np.maximum(last, 0)[:, None])]
    return a + (at - below) * (b - a)


def _rescaled(rows: list[Row], units: Sequence[tuple[float, str]]) -> tuple[str, list[Row]]:
    """The first unit that is not larger than the largest value, and the rows in this unit."""
    values = [e.value for row in rows for estimates in row.models.values() for e in estimates]
    largest = max(values, default=1.0)
    size, unit = next((u for u in units if largest >= u[0]), units[-1])

    def scaled(e: CountedEstimate) -> CountedEstimate:
        return CountedEstimate(e.value / size, e.low / size, e.high / size, e.count)

    return unit, [
        Row(row.block, row.place, {name: [scaled(e) for e in own] for name, own in row.models.items()}) for row in rows
    ]
