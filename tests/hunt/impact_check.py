"""The engines against the independent integrator over random impacts: `python -m tests.hunt.integrator`."""

import argparse
from collections import Counter
from typing import NamedTuple

import numpy as np

from rock2d.effects.columns import engine_rows
from rock2d.engines.batch import BATCH_STEP_FRACTION, Ensemble, run_batch
from rock2d.engines.contact_step import contact_steps_s
from rock2d.engines.pymunk_engine import run_pymunk
from rock2d.laws.contact import contact_table
from rock2d.records.columns import AFTER, BEFORE, I_PENETRATION, IMPACT_NAMES, STOPS
from tests.hunt.cases import GRAVITY_M_S2, SHAPES, Case, random_site, random_states
from tests.hunt.integrator import Impact, LeftOutError, Outcome

Array = np.ndarray
LARGEST = 1e-3  # difference of velocities after an impact, of the incident speed
FINE = 0.05  # step fraction of the engine at which it is compared again
NUDGE = 1e-9  # relative change of a start that tells a knife edge
PYMUNK_EVERY = 4  # impacts: one of these runs in the pymunk engine too


class Compared(NamedTuple):
    """One impact: the integrator's outcome, and differences of (velocities, largest penetration), relative."""

    case: Case
    outcome: Outcome
    batch: tuple[float, float]
    pymunk: tuple[float, float]


def batch_impact(case: Case, fraction: float = BATCH_STEP_FRACTION) -> Array:
    """The first impact (17,) of a release in the batch engine. Raises LeftOutError if it does not end."""
    site = case.site
    table = contact_table(site.soils, site.cross_section.zone_names)
    result = run_batch(
        Ensemble([site.block], [site.cross_section], [table]), case.state[None], gravity_m_s2=GRAVITY_M_S2,
        time_limit_s=site.time_limit_s, impact_limit=1, impact_room=1, step_fraction=fraction,
    )  # fmt: skip
    if STOPS[result.stop[0]] != "impacts":
        raise LeftOutError(f"engine: {STOPS[result.stop[0]]}")
    return result.impacts[0, 0]


def pymunk_impact(case: Case, refinement: float = 1.0) -> Array:
    """The same in the pymunk engine, at `refinement` times its step; NaN if it does not end."""
    site = case.site
    table = contact_table(site.soils, site.cross_section.zone_names)
    track = run_pymunk(
        site.block, site.cross_section, table, case.state, gravity_m_s2=GRAVITY_M_S2,
        time_limit_s=site.time_limit_s, impact_limit=1,
        contact_step_s=refinement * contact_steps_s(site.block, engine_rows(table))[1],
    )  # fmt: skip
    if track.stop != "impacts":
        return np.full(len(IMPACT_NAMES), np.nan)
    return np.array([0.0, *(track.impacts[0][name] for name in IMPACT_NAMES[1:])])


def difference(case: Case, row: Array, outcome: Outcome) -> tuple[float, float]:
    """Difference of the velocities after an impact (of the incident speed; that of the spin times the block's reach),
    and of its largest penetration (of itself)."""
    after, before = row[AFTER], outcome.before
    change = (after - outcome.after)[3:] * [1.0, 1.0, case.site.block.reach_m]
    depth = row[I_PENETRATION] / outcome.penetration_m - 1.0
    return float(np.abs(change).max() / np.hypot(*before[3:5])), float(abs(depth))


def outcome_row(outcome: Outcome) -> Array:
    """An outcome of the integrator as a row of impacts, as far as `difference` reads it."""
    row = np.full(len(IMPACT_NAMES), np.nan)
    row[BEFORE], row[AFTER], row[I_PENETRATION] = outcome.before, outcome.after, outcome.penetration_m
    return row


def compared_impacts(count: int, seed: int, fraction: float, pymunk_every: int = 0) -> tuple[list[Compared], Counter]:
    """`count` impacts of random releases, all shapes in turn, and why others were left out."""
    rng, done, left_out = np.random.default_rng(seed), [], Counter()
    while len(done) < count:
        site = random_site(rng, SHAPES[len(done) % len(SHAPES)])
        case = Case(site, random_states(rng, site, 1)[0])
        try:
            row = batch_impact(case, fraction)
            outcome = Impact(site, case.state).run()
        except LeftOutError as reason:
            left_out[str(reason)] += 1
            continue
        other = np.nan, np.nan
        if pymunk_every and len(done) % pymunk_every == 0:
            other = difference(case, pymunk_impact(case), outcome)
        done.append(Compared(case, outcome, difference(case, row, outcome), other))
    return done, left_out


def reason(one: Compared) -> str:
    """Why an engine's impact is apart from the integrator's."""
    case, nudged = one.case, one.case.state * (1.0 + NUDGE * np.array([1, -1, 1, -1, 1, -1]))
    for fraction in (0.5 * BATCH_STEP_FRACTION, FINE, 0.2 * FINE):
        if difference(case, batch_impact(case, fraction), one.outcome)[0] < LARGEST:
            return f"step of the engine (none at a fraction of {fraction:g})"
    try:
        twin = Impact(case.site, nudged).run()
    except LeftOutError as other:
        return f"knife edge: a nudged start {other}"
    apart = difference(case, outcome_row(twin), one.outcome)[0]
    return "knife edge" if apart > 0.3 * one.batch[0] else f"not known (a nudged start: {apart:.1e})"


def print_table(done: list[Compared], left_out: Counter) -> None:
    """Differences by shape, and the impacts that are apart."""
    print("velocities: of the incident speed; penetration: of itself; each median, 95 %, worst")
    for shape in (*SHAPES, "all"):
        mine = [d for d in done if shape in ("all", d.case.site.block.shape)]
        if not mine:
            continue
        text = f"{shape:10s}{len(mine):4d}  vertex {sum(d.outcome.at_vertex for d in mine):3d}"
        text += f"  several contacts {sum(d.outcome.most_contacts > 1 for d in mine):3d}"
        for name, values in (
            ("velocities", [d.batch[0] for d in mine]), ("penetration", [d.batch[1] for d in mine]),
            ("pymunk", [d.pymunk[0] for d in mine if np.isfinite(d.pymunk[0])]),
        ):  # fmt: skip
            if values:
                text += f"  {name} " + " ".join(f"{v:.1e}" for v in np.quantile(values, [0.5, 0.95, 1.0]))
        print(text)
    print(f"left out {sum(left_out.values())}: {dict(left_out)}")
    for k, one in enumerate(done):
        out = one.outcome
        text = f"  {k} {one.case.site.block.shape}: velocities {one.batch[0]:.1e}, penetration {one.batch[1]:.1e}"
        text += f", pymunk {one.pymunk[0]:.1e}; {out.most_contacts} contacts, {out.segments} regimes"
        text += ", at a vertex" if out.at_vertex else ""
        if one.batch[0] > LARGEST:
            print(f"{text}: {reason(one)}")
        elif one.pymunk[0] > LARGEST:
            print(f"{text}: pymunk alone")


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--impacts", type=int, default=200)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--fraction", type=float, default=BATCH_STEP_FRACTION, help="step of the batch engine")
    given = parser.parse_args(arguments)
    print_table(*compared_impacts(given.impacts, given.seed, given.fraction, PYMUNK_EVERY))
    return 0
