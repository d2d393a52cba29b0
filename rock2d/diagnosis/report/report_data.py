"""Data for the report: residuals of each impact, the impacts that the effect improves most, and the releases of the
video."""

from dataclasses import replace

import numpy as np

from rock2d.arrays import Array
from rock2d.diagnosis.cross_validation import HeldOut, Validated
from rock2d.diagnosis.data import FilmData
from rock2d.diagnosis.diagnose import Diagnosis
from rock2d.diagnosis.diagnosis_content import reported_effect
from rock2d.diagnosis.likelihood import standard_deviations
from rock2d.diagnosis.replay import Releases, Signs, recorded_simulation
from rock2d.diagnosis.report.figures import MODEL_STYLES, Misses, ShownImpact
from rock2d.diagnosis.residual_regression import LARGEST_RESIDUAL_SD, clipped
from rock2d.graphics.canvas import Limits
from rock2d.graphics.clips import Clip
from rock2d.kinematics.sanity import MIRRORED_SIGNS
from rock2d.records.columns import POSITION
from rock2d.scene.cross_section import CrossSection
from rock2d.scene.world import World

# the models that a report compares: the "base" law, and if there is a gap to explain, the model with the "effect"
Models = dict[str, Validated]
MOST_SHOWN_IMPACTS = 6
LINE_POINTS = 160  # points of a predicted line
SHOWN_AFTER = 2.5  # shown part of the flight after an impact, in units of `FlightPairs.window_s`
FLIGHT_POINTS = 12
MOST_FLIGHTS = 600
MOST_SCENES = 3


def compared_models(result: Diagnosis) -> Models:
    """The base law and the model whose gap is reported; only the base law if there is no gap.

    An effect that only widens the scatter predicts the same motion as the base. Unless it is the verdict, the best
    effect that changes the motion is used instead."""
    found = result.found
    assert found is not None
    models: Models = {"base": found.base}
    if found.verdict != "none" and (found.verdict != "unknown" or found.named):
        name = reported_effect(found)
        joint = name in (one.effect.name for one in found.chain)
        models["effect"] = found.final if joint else found.candidates[name]
    return models


def signs_of(result: Diagnosis) -> Signs:
    """Signs of x, y and theta that correct a mirrored axis."""
    return MIRRORED_SIGNS[result.sanity.mirror]


def corrected_setup(result: Diagnosis) -> World:
    """The stated set-up, with a mirrored axis corrected."""
    return replace(result.setup, view=replace(result.setup.view, mirror=signs_of(result)))


def impact_squares(result: Diagnosis, out: HeldOut) -> Array:
    """(n,) mean square of each impact's held-out residuals in standard deviations."""
    found = result.found
    assert found is not None
    sd = standard_deviations(found.final.fit.covariance())
    return (clipped(out.residuals.impacts / sd) ** 2).mean(axis=1)


def impact_misses(result: Diagnosis, out: HeldOut) -> Misses:
    """Place of every impact, and size of its held-out residuals."""
    data = result.data
    assert data is not None
    sigma = np.sqrt(impact_squares(result, out))
    if isinstance(data, FilmData):
        return Misses(touch_places(result, data), data.impact_block, sigma)
    return Misses(data.before[:, POSITION], data.impact_block, sigma)


def touch_places(result: Diagnosis, data: FilmData) -> Array:
    """(n, 2) centroid half-way between the ends of the flights around each impact, with mirrored axes corrected."""
    return 0.5 * np.add(*states_around(result, data))[:, POSITION]


def states_around(result: Diagnosis, data: FilmData) -> tuple[Array, Array]:
    """(n, 6) states at the end of the flight before each impact and at the beginning of the flight after it, with
    mirrored axes corrected."""
    setup, impacts = corrected_setup(result), data.impacts
    ends = data.film.t_s[data.flights.last[impacts.before] - 1]
    before = data.states_at(setup, impacts.before, ends - data.flights.middle[impacts.before])
    return before, data.states_at(setup, impacts.after, impacts.begin_s)


def flight_lines(data: FilmData, signs: Signs) -> list[Array]:
    """(k, 2) positions in a few frames of each measured flight, for at most MOST_FLIGHTS flights."""
    flights = data.flights
    chosen = np.unique(np.linspace(0, len(flights) - 1, min(len(flights), MOST_FLIGHTS)).round().astype(int))
    paths = []
    for i in chosen:
        rows = np.unique(np.linspace(flights.first[i], flights.last[i] - 1, FLIGHT_POINTS).round().astype(int))
        paths.append(data.film.pose[rows, :2] * signs[:2])
    return paths


def shown_impacts(result: Diagnosis, models: Models, improves: bool) -> list[ShownImpact]:
    """The impacts that the effect improves most or, unless it `improves`, those with the largest residuals."""
    data = result.data
    assert isinstance(data, FilmData)
    squares = {name: impact_squares(result, model.held_out) for name, model in models.items()}
    base, effect = squares["base"], squares.get("effect")
    chosen: list[int] = []
    for i in np.argsort(effect - base if improves and effect is not None else -base, kind="stable"):
        if data.impacts.release[i] not in data.impacts.release[chosen]:  # one impact of a release
            chosen.append(int(i))
        if len(chosen) == MOST_SHOWN_IMPACTS:
            break
    signs, which = signs_of(result), np.array(chosen)
    impacts, middle = data.impacts, data.flights.middle
    start = middle[impacts.before[which]] + impacts.start_s[which]
    begin = middle[impacts.after[which]] + impacts.begin_s[which]
    flights_end = data.film.t_s[data.flights.last[impacts.after[which]] - 1]
    end = np.minimum(flights_end, begin + SHOWN_AFTER * impacts.window_s[which])
    t = start[:, None] + np.linspace(0.0, 1.0, LINE_POINTS) * (end - start)[:, None]
    poses = {}
    for name, own in models.items():
        world = own.fit.model.world(own.fit.p, data.impact_order[which])
        poses[name] = recorded_simulation(data, world, impacts.before[which], t, start, signs)
    blocks, zones = list(result.experiment.blocks.items()), result.experiment.cross_section.zone_names
    shown = []
    for k, i in enumerate(which):
        film = data.film
        rows = np.flatnonzero((film.release == impacts.release[i]) & (film.t_s >= start[k]) & (film.t_s <= end[k]))
        name, block = blocks[impacts.block[i]]
        place = f"{name} {film.release_names[impacts.release[i]]}, {zones[impacts.zone[i]]}".replace("_", " ")
        miss = f"residual {_sigma(base[i])}" + (f", then {_sigma(effect[i])}" if effect is not None else "")
        shown.append(ShownImpact(
            f"{place}\n{miss}", block, np.column_stack([film.t_s[rows], film.pose[rows] * signs]),
            {m: np.column_stack([t[k], pose[k]]) for m, pose in poses.items()},
        ))  # fmt: skip
    return shown


def _sigma(square: float) -> str:
    """Text of a residual; residuals of LARGEST_RESIDUAL_SD were clipped."""
    root = float(np.sqrt(square))
    return f"{root:.1f} σ" if root < 0.98 * LARGEST_RESIDUAL_SD else f"≥ {LARGEST_RESIDUAL_SD:g} σ"


def distances(film: Releases, poses: Array) -> Array:
    """(n,) root mean square distance in m between simulated (n, k, 3) and measured releases."""
    gap = poses[..., :2] - film.pose[..., :2]
    return np.sqrt(np.nanmean((gap**2).sum(axis=-1), axis=1))


def video_scenes(
    result: Diagnosis, film: Releases, models: dict[str, Array], improves: bool
) -> tuple[list[list[list[Clip]]], list[str]]:
    """Clips of one release of each block, measured and of every model (n, k, 3), and their titles.

    If the effect `improves`, it is the release whose distance from the film falls most; else the one with the median
    distance between base and film."""
    distance = {name: distances(film, poses) for name, poses in models.items()}
    gain = (
        distance["base"] - distance["effect"] if improves else -np.abs(distance["base"] - np.median(distance["base"]))
    )
    scenes, titles = [], []
    blocks = list(result.experiment.blocks)
    best_first = sorted(set(film.block.tolist()), key=lambda b: -float(np.median(gain[film.block == b])))
    assert isinstance(result.data, FilmData)
    names = result.data.film.release_names
    for b in best_first[:MOST_SCENES]:
        own = np.flatnonzero(film.block == b)
        i = own[np.argmax(gain[own])]
        shown = _until_still(film.t_s[i], film.pose[i], result.experiment.blocks[blocks[b]].radius_m)
        t = film.t_s[i, shown]
        lost = 6.0 * float(np.median(np.diff(t)))
        clips = []
        for name, pose in {"measured": film.pose[i], **{m: p[i] for m, p in models.items()}}.items():
            gap = lost if name == "measured" else np.inf
            x, y, theta = pose[shown].T
            clips.append([Clip(blocks[b], t - t[0], x, y, theta, name, MODEL_STYLES[name][0], gap)])
        scenes.append(clips)
        titles.append(f"{blocks[b]}, release {names[film.release[i]]}".replace("_", " "))
    return scenes, titles


def scenes_view(scenes: list[list[list[Clip]]], cross_section: CrossSection, radius_m: float) -> Limits:
    """Limits of the video: the paths of the measured blocks with a margin of half their extent, and the ground
    below."""
    clips = [clip for scene in scenes for panel in scene for clip in panel]
    filmed = [scene[0][0] for scene in scenes]
    limits = []
    for key in ("x_m", "y_m"):
        low, high = min(np.min(getattr(c, key)) for c in filmed), max(np.max(getattr(c, key)) for c in filmed)
        room = 0.5 * (high - low)
        limits.append(max(low - room, min(np.min(getattr(c, key)) for c in clips)) - 2.0 * radius_m)
        limits.append(min(high + room, max(np.max(getattr(c, key)) for c in clips)) + 2.0 * radius_m)
    left, right, low, high = map(float, limits)
    ground = cross_section.height_m(np.linspace(left, right, 50))
    low = min([low, *ground[np.isfinite(ground)]])
    return left, right, low - 0.15 * (high - low), high + 0.1 * (high - low)  # room for names


def _until_still(t: Array, pose: Array, radius_m: float) -> Array:
    """Frames until shortly after the block comes within a tenth of its radius of its last position."""
    known = np.flatnonzero(np.isfinite(t))
    away = np.hypot(*(pose[known, :2] - pose[known[-1], :2]).T)
    moving = np.flatnonzero(away > 0.1 * radius_m)
    last = int(moving[-1]) if len(moving) else len(known) - 1
    return known[: min(len(known), last + max(2, len(known) // 20))]
