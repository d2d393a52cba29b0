"""Arguments, options and help of the commands about a site: `run`, `profile`, `design`, `soils`."""

import shlex
import sys
from pathlib import Path

import click

from rock2d.runs.campaigns import OUTPUTS
from rock2d.runs.engines import ENGINES

ENGINE = click.Choice(list(ENGINES))
OUTPUT = click.Choice(list(OUTPUTS))
SCHEDULER_WORKERS = "on the workers of this Dask scheduler (tcp://host:port). They need rock2d, one thread each"
ON_SCHEDULER = f"{SCHEDULER_WORKERS}, and must share a file system with this process: they write the files."


def command_line() -> str:
    """The command as it was given."""
    return shlex.join(["rock2d", *sys.argv[1:]])


DATA = click.option("--data", "data_root", type=click.Path(path_type=Path), envvar="ROCK2D_DATA",
                    help="Folder of measured data (or the variable ROCK2D_DATA).")  # fmt: skip
PDF = click.option("--pdf", is_flag=True, help="Also write the page as report.pdf; needs pip install 'rock2d[pdf]'.")
SEED = click.option("--seed", type=click.IntRange(0, 2**63 - 1), help="Seed instead of the scenario's.")
OVERWRITE = click.option("--overwrite", is_flag=True, help="Replace the results of an earlier run.")
QUIET = click.option("--quiet", is_flag=True, help="No progress bar.")


@click.command()
@click.argument("scenarios", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--engine", "engines", multiple=True, type=ENGINE, help="Engine; may be given twice.")
@SEED
@click.option("--releases", type=click.IntRange(1), help="Releases of each block instead of the scenario's.")
@click.option("--out", type=click.Path(path_type=Path), default=Path("out"), show_default=True,
              help="Folder under which each run gets its own.")  # fmt: skip
@DATA
@click.option("--video", is_flag=True, help="Also write a video of the first releases.")
@click.option("--report", is_flag=True, help="Also write report.html, a page to read, print and hand in.")
@PDF
@click.option("--compare", is_flag=True,
              help="Also run the other law, rough or smooth ground, softer and harder soil, and blocks of other "
              "shapes, to see how much the results depend on these.")  # fmt: skip
@click.option("--precision", type=click.FloatRange(0.01, 50), metavar="PERCENT",
              help="Add releases until the half-width of the 95 % interval of every passing frequency is at most this "
              "many percentage points.")  # fmt: skip
@click.option("--no-figures", is_flag=True, help="Tables only, and a page without pictures.")
@click.option("--workers", type=click.IntRange(1),
              help="Processes. Default: all cores; a campaign: this process, on all threads.")  # fmt: skip
@click.option("--scheduler", metavar="ADDRESS", help=f"Campaign {ON_SCHEDULER}")
@click.option("--keep", multiple=True, type=OUTPUT,
              help="What a campaign keeps of each release; may be given several times. Default: ends and "
              "crossings. With crossings alone, a release stops as soon as it can reach no other line; samples "
              "(at the frame rate of the scenario) are large.")  # fmt: skip
@click.option("--predict", type=click.Path(path_type=Path), metavar="RELEASES.csv",
              help="For a scenario with a field test: forecast the releases of this table; --out is then the table "
              "(CSV) to write.")  # fmt: skip
@OVERWRITE
@QUIET
def run(scenarios, engines, out, data_root, video, report, pdf, compare, precision, predict, overwrite, quiet,
        **options) -> None:  # fmt: skip
    """Run SCENARIOS (YAML) and write experiment folders, tables and figures.

    A run with more than 10,000 releases in all, or with --scheduler, is a campaign: it is computed in chunks, keeps
    no full tracks (no trajectories or video; figures only with --report), and writes tables and parquet files. The
    same command continues it after an interruption. Campaigns need pip install 'rock2d[scale]'.

    If more than 1 % of the releases of a block ran out of time or sank into the ground, the last lines say so, and the
    exit code is 4.

    Example: rock2d run site.yaml --engine batch --releases 500 --report"""
    from rock2d.cluster import Workers
    from rock2d.commands.run import RunRequest, run_scenarios
    from rock2d.runs.campaigns.campaign import CampaignOptions

    campaign = CampaignOptions(None, options["seed"], options["releases"], options["keep"])
    request = RunRequest(
        out, campaign, Workers(options["workers"], options["scheduler"]), engines=engines, video=video,
        page_command=command_line() if report or pdf else None, pdf=pdf, compare=compare,
        precision=precision and precision / 100.0, draw=not options["no_figures"], overwrite=overwrite,
        progress=not quiet, report=click.echo,
    )  # fmt: skip
    if not run_scenarios(scenarios, request, data_root=data_root, predict=predict):
        sys.exit(4)


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--line", nargs=4, type=float, metavar="X0 Y0 X1 Y1",
              help="For a terrain model: the section between two points.")  # fmt: skip
@click.option("--fall-line", "start", nargs=2, type=float, metavar="X Y",
              help="For a terrain model: the section down the steepest slope from a point.")  # fmt: skip
@click.option("--layer", help="For a drawing: read only the lines of this layer.")
@click.option("--zones", type=click.Path(path_type=Path), help="Table (CSV) of start, end and name of zones.")
@click.option("--tolerance", "tolerance_m", type=click.FloatRange(min=0), default=0.0, show_default=True,
              metavar="M", help="Leave out points that change the surface by less.")  # fmt: skip
@click.option("--release", nargs=2, type=float, metavar="LOW HIGH",
              help="Stations between which blocks start. Default: upper half of the highest steep face.")  # fmt: skip
@click.option("--smooth", is_flag=True, help="Smooth ground, without the roughness of the soil classes.")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Scenario file (.yaml) to write.")
@click.option("--overwrite", is_flag=True, help="Replace a file that exists.")
def profile(file, out, overwrite, **options) -> None:
    """Write a complete scenario, and a picture, from the slope profile in FILE.

    FILE is a table (CSV: station and height, or x, y, z), a drawing (DXF: its longest polyline) or a terrain model
    (GeoTIFF, ESRI ASCII grid). Drawings and terrain models need pip install 'rock2d[profile]'.

    Example: rock2d profile terrain.asc --fall-line 30 235 --tolerance 0.1 --out site.yaml"""
    from rock2d.commands.profile import ProfileOptions, write_profile

    write_profile(file, out, ProfileOptions(**options), overwrite=overwrite, report=click.echo)


@click.command()
@click.argument("scenario", type=click.Path(path_type=Path))
@click.option("--vary", "place", default="embankment.height_m", show_default=True,
              help="Place of the number in the scenario to minimize; with several embankments, for example, "
              "embankment.2.height_m.")  # fmt: skip
@click.option("--range", "bounds", nargs=2, type=float, required=True, metavar="LOW HIGH",
              help="Least and greatest value, in the unit of the number.")  # fmt: skip
@click.option("--over", "others", nargs=3, type=(str, float, float), multiple=True, metavar="PLACE LOW HIGH",
              help="Minimize the volume of earth, and also vary another number between LOW and HIGH, for example "
              "embankment.uphill_deg 60 90; may be given up to three times.")  # fmt: skip
@click.option("--line", help="Measure line that blocks must not pass. Default: crest, or crest_2 if --vary names a "
              "number of embankment or ditch 2.")  # fmt: skip
@click.option("--target", type=float, default=1.0, show_default=True, metavar="PERCENT",
              help="Largest share of the releases of each block that may pass.")  # fmt: skip
@click.option("--per", type=click.Choice(["released", "arriving"]), default="released", show_default=True,
              help="The share is that of the released or of the arriving blocks.")  # fmt: skip
@click.option("--above-kj", type=click.FloatRange(min=0), metavar="KJ",
              help="Count only blocks that pass with more energy, for example more than a fence behind it "
              "can stop.")  # fmt: skip
@click.option("--above-m", type=float, metavar="M",
              help="Count only blocks that pass higher above the foot of the line.")  # fmt: skip
@click.option("--confidence", type=float, default=95.0, show_default=True, metavar="PERCENT",
              help="Confidence with which the target is met, over sampling and all that is not known.")  # fmt: skip
@click.option("--tolerance", type=click.FloatRange(min=0, min_open=True),
              help="Tolerance of the least value. Default: 1/50 of the range.")  # fmt: skip
@click.option("--engine", type=ENGINE, help="Engine instead of the scenario's; pymunk is computed with batch.")
@SEED
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/design"), show_default=True,
              help="Folder for the table, the curve and the scenario of the least value.")  # fmt: skip
@DATA
@click.option("--workers", type=click.IntRange(1), help="Processes. Default: this process, on all threads.")
@click.option("--scheduler", metavar="ADDRESS", help=f"Possible sites {SCHEDULER_WORKERS}.")
@PDF
@OVERWRITE
@QUIET
def design(
    scenario,
    *,
    place,
    bounds,
    others,
    line,
    target,
    per,
    above_kj,
    above_m,
    confidence,
    workers,
    scheduler,
    out,
    quiet,
    **options,
) -> None:
    """Find the smallest embankment that meets a target, by bisection over a number of SCENARIO.

    Every value is judged on the same possible sites (key uncertainty of the scenario) with the same releases. If no
    value of the range meets the target, the exit code is 4.

    Example: rock2d design site.yaml --range 2 8 --target 1 --confidence 95"""
    from rock2d.cluster import Workers
    from rock2d.design.command import run_design
    from rock2d.design.least_size import Target, line_of_place

    line = line or line_of_place(place)
    aim = Target(line, target / 100.0, confidence / 100.0, per, 1e3 * (above_kj or 0.0), above_m)
    answer = run_design(
        scenario, place, bounds, aim, out, over=others, workers=Workers(workers, scheduler), progress=not quiet,
        command=command_line(), report=click.echo, **options,
    )  # fmt: skip
    if answer.least is None:
        sys.exit(4)


@click.command()
@click.option("--mass-kg", type=float, metavar="KG", help="Mass of a block; needs --size-m.")
@click.option("--size-m", type=float, metavar="M",
              help="Size of the block: the diameter of the circle with the area of its profile.")  # fmt: skip
def soils(mass_kg, size_m) -> None:
    """List the soil classes for the key soils of a scenario: restitution, friction, stiffness, ranges and sources. With
    --mass-kg and --size-m, print the parameters of both impact laws for that block.

    Example: rock2d soils --mass-kg 2700 --size-m 1.2"""
    from rock2d.commands.soils import list_soils

    list_soils(mass_kg, size_m, report=click.echo)


SITE_COMMANDS = (run, profile, design, soils)
