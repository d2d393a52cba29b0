"""Computing time by number of releases and of facets, for both compiled engines: cost.png and cost.json.

    python -m rock2d_figures.cost                        # up to a million releases
    python -m rock2d_figures.cost --releases 10000000

Releases: the paper's set-up, sphere, from the incident state to rest or exit. Facets: the scenario slope_embankment,
its 1 m cube, on the same profile with more and more facets and a small smooth undulation on the long ones. The engines
run in turns on all threads; times do not include compilation. Runs above COST_RELEASES_PER_CALL releases repeat the
first incident states call by call, so that memory stays bounded; the point mass has other seeds in each call."""

import json
import os
import platform
from collections.abc import Callable, Hashable, Mapping
from pathlib import Path
from time import perf_counter
from typing import Any, TypeVar

import click
import numba
import numpy as np
from matplotlib.figure import Figure

from rock2d.arrays import Array
from rock2d.engines.batch import Ensemble, run_batch
from rock2d.engines.point_mass import run_point_mass_batch
from rock2d.files.scenario import Scenario, scenario_file
from rock2d.files.scenario_reading import load_scenario
from rock2d.graphics.figure_style import blank_figure, finish, save_figure
from rock2d.graphics.palette import block_colours
from rock2d.laws.contact import contact_table
from rock2d.runs.conditions import incident_states
from rock2d.scene.cross_section import CrossSection
from rock2d.version import __version__

Key = TypeVar("Key", bound=Hashable)

OUTPUT_FOLDER = Path(__file__).resolve().parents[1]
SEED = 1
COST_RELEASES_PER_CALL = 100_000  # releases in one call
FACET_COUNTS = (10, 30, 100, 300, 1000, 3000, 10_000)
FACET_RELEASES = {"batch": 500, "point mass": 10_000}
UNDULATION_LENGTH_M, UNDULATION_HEIGHT_M = 8.0, 0.05  # its shortest wave
ENGINES = ("batch", "point mass")


@click.command(context_settings={"show_default": True})
@click.option("--releases", type=click.IntRange(100), default=1_000_000, help="Largest number of releases.")
@click.option("--rounds", type=click.IntRange(1), default=5, help="Repetitions of each measurement.")
@click.option("--seconds", type=float, default=60.0, help="Time after which no repetition begins.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=OUTPUT_FOLDER,
    show_default="figures/",
    help="Folder of the files.",
)
def main(releases: int, rounds: int, seconds: float, out: Path) -> None:
    """Measure, write cost.json and draw cost.png."""
    numbers = {
        "machine": machine(),
        "releases": cost_of_releases(releases, rounds, seconds),
        "facets": cost_of_facets(rounds, seconds),
    }
    out.mkdir(parents=True, exist_ok=True)
    (out / "cost.json").write_text(json.dumps(numbers, indent=2) + "\n", encoding="utf-8")
    save_figure(figure_of(numbers), out / "cost.png")
    for engine in ENGINES:
        own = numbers["releases"][engine]
        rate = own["releases"][-1] / own["median_s"][-1]
        ratio = numbers["facets"][engine]["10000_to_100_facets"]
        click.echo(f"{engine}: {rate:,.0f} releases/s; 10,000 facets cost {ratio:.2f} times 100 facets")


def cost_of_releases(most: int, rounds: int, seconds: float) -> dict[str, Any]:
    """By engine: numbers of releases, all times in s, their medians."""
    scenario = load_scenario(scenario_file("paper_setup.yaml"))
    states = incident_states_of(scenario, "sphere", min(most, COST_RELEASES_PER_CALL))
    numbers = [10**k for k in range(2, 8) if 10**k < most] + [most]
    found: dict[str, Any] = {e: {"releases": numbers, "times_s": [], "median_s": []} for e in ENGINES}
    for number in numbers:
        runs = {e: prepared_run(e, scenario, "sphere", scenario.make_cross_section(), states, number) for e in ENGINES}
        for engine, times in times_in_turns(runs, rounds, seconds).items():
            found[engine]["times_s"].append(times)
            found[engine]["median_s"].append(float(np.median(times)))
    return found


def cost_of_facets(rounds: int, seconds: float) -> dict[str, Any]:
    """By engine: numbers of facets, all times in s per release, their medians, and the ratio of 10⁴ to 100 facets
    (median of the rounds)."""
    scenario = load_scenario(scenario_file("slope_embankment.yaml"))
    states = incident_states_of(scenario, "cube_1m", max(FACET_RELEASES.values()))
    runs = {
        (engine, n): prepared_run(
            engine, scenario, "cube_1m", resampled(scenario.make_cross_section(), n), states, number
        )
        for engine, number in FACET_RELEASES.items()
        for n in FACET_COUNTS
    }
    times = times_in_turns(runs, rounds, seconds)
    found = {}
    for engine, number in FACET_RELEASES.items():
        each = {n: np.array(times[engine, n]) / number for n in FACET_COUNTS}
        found[engine] = {
            "facets": FACET_COUNTS,
            "releases": number,
            "times_s": [list(t) for t in each.values()],
            "median_s": [float(np.median(t)) for t in each.values()],
            "10000_to_100_facets": float(np.median(each[10_000] / each[100])),
        }
    return found


def times_in_turns(runs: Mapping[Key, Callable[[], object]], rounds: int, seconds: float) -> dict[Key, list[float]]:
    """Times in s of each run, taken in turns; no round begins after `seconds`."""
    times: dict[Key, list[float]] = {key: [] for key in runs}
    begin = perf_counter()
    for _ in range(rounds):
        for key, run in runs.items():
            start = perf_counter()
            run()
            times[key].append(perf_counter() - start)
        if perf_counter() - begin > seconds:
            break
    return times


def prepared_run(
    engine: str, scenario: Scenario, block_name: str, cross_section: CrossSection, states: Array, number: int
) -> Callable[[], None]:
    """A function that simulates `number` releases; the engine is compiled already."""
    block = scenario.make_blocks()[block_name]
    shared: dict[str, Any] = {"gravity_m_s2": scenario.gravity_m_s2, "time_limit_s": scenario.longest_release_s()}
    table = contact_table(scenario.contact_parameters(block), cross_section.zone_names)
    law = scenario.rebound_parameters(block)
    ensemble = Ensemble([block], [cross_section], [table])

    def run(number: int = number) -> None:
        for first in range(0, number, COST_RELEASES_PER_CALL):
            part = states[: min(COST_RELEASES_PER_CALL, number - first)]
            if engine == "batch":
                run_batch(ensemble, part, stop_when_captured=True, **shared)
            else:
                seeds = np.arange(first, first + len(part), dtype=np.uint64)
                run_point_mass_batch(block, cross_section, law, part, seeds, **shared)

    run(2)
    return run


def incident_states_of(scenario: Scenario, block_name: str, number: int) -> Array:
    """(number, 6) drawn states of one block."""
    return np.array([s.state for s in incident_states(scenario, SEED, number) if s.block == block_name])


def resampled(cross_section: CrossSection, facets: int) -> CrossSection:
    """The profile divided into `facets` facets in proportion to length; long ones undulate in whole waves."""
    start, edge = cross_section.points_m[:-1], np.diff(cross_section.points_m, axis=0)
    length = np.hypot(*edge.T)
    share = np.cumsum(length) / length.sum() * (facets - len(length))
    pieces = 1 + np.diff(np.round(share).astype(int), prepend=0)
    points, zones = [], []
    for a, along, long, n, zone in zip(start, edge, length, pieces, cross_section.zones, strict=True):
        u = np.arange(n) / n
        part = a + u[:, None] * along
        part[:, 1] += UNDULATION_HEIGHT_M * np.sin(2 * np.pi * (long // UNDULATION_LENGTH_M) * u)
        points.append(part)
        zones += [zone] * n
    return CrossSection(np.vstack([*points, cross_section.points_m[-1:]]), zones, cross_section.measure_lines)


def machine() -> dict[str, Any]:
    """Processor and versions of the measurement."""
    model = platform.processor() or platform.machine()
    about = Path("/proc/cpuinfo")
    if about.exists():
        names = [line.split(":", 1)[1].strip() for line in about.read_text().splitlines() if "model name" in line]
        model = names[0] if names else model
    return {
        "processor": model, "cores": os.cpu_count(), "threads": numba.get_num_threads(),
        "python": platform.python_version(), "numba": numba.__version__, "rock2d": __version__,
    }  # fmt: skip


def figure_of(numbers: Mapping[str, Any]) -> Figure:
    """Time against the number of releases; time of one release against the number of facets."""
    figure = blank_figure(7.5, 3.3)
    left, right = figure.subplots(1, 2)
    colours = block_colours(ENGINES)
    for engine, marker in zip(ENGINES, "os", strict=True):
        line = {"color": colours[engine], "marker": marker, "ms": 4, "lw": 1.4, "label": engine}
        own = numbers["releases"][engine]
        left.plot(own["releases"], own["median_s"], **line)
        left.vlines(own["releases"], *_range(own, 1.0), color=colours[engine])
        rate = own["releases"][-1] / own["median_s"][-1]
        left.annotate(
            f"{rate:,.0f} releases/s".replace(",", " "), (own["releases"][-1], own["median_s"][-1]),
            (-8, 0) if engine == "batch" else (0, -58), textcoords="offset points", ha="right",
            va="bottom" if engine == "batch" else "top", fontsize=7.5, color=colours[engine],
        )  # fmt: skip
        own = numbers["facets"][engine]
        micro = np.array(own["median_s"]) * 1e6
        right.plot(own["facets"], micro, **line)
        right.vlines(own["facets"], *_range(own, 1e6), color=colours[engine])
        right.annotate(
            f"10 000 facets: {own['10000_to_100_facets']:.2f} × 100 facets", (own["facets"][-1], micro[-1]), (4, 7),
            textcoords="offset points", ha="right", va="bottom", fontsize=7.5, color=colours[engine],
        )  # fmt: skip
    left.set_title("the paper's set-up, sphere", loc="left", fontsize=9)
    right.set_title("slope of 140 m, cube of 1 m", loc="left", fontsize=9)
    left.set(xlabel="releases", ylabel="time (s)", xscale="log", yscale="log")
    right.set(xlabel="facets", ylabel="time of a release (µs)", xscale="log", yscale="log")
    right.set_ylim(0.5 * min(numbers["facets"]["point mass"]["median_s"]) * 1e6,
                   4.0 * max(numbers["facets"]["batch"]["median_s"]) * 1e6)  # fmt: skip
    for axis in (left, right):
        axis.grid(color="#e4e4e4", lw=0.6)
        axis.tick_params(which="minor", length=0)
    finish(figure)
    left.legend(frameon=False, fontsize=8, loc="upper left")
    about = numbers["machine"]
    note = f"{about['processor']}, {about['threads']} threads; bars: least and greatest of the repetitions"
    figure.supxlabel(note, x=0.99, ha="right", fontsize=6.5, color="#777777")
    return figure


def _range(own: Mapping[str, Any], factor: float) -> tuple[list[float], list[float]]:
    """The least and the greatest time of each measurement, times `factor`."""
    return [min(t) * factor for t in own["times_s"]], [max(t) * factor for t in own["times_s"]]


if __name__ == "__main__":
    main()
