"""The command line. Heavy imports happen inside the commands, so that `rock2d --help` is instant."""

import gc
import math
import os
import sys
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import click
from rock2d_tracking import FROM_GRAVITY
from rock2d_tracking.importers import importer_names
from rock2d_tracking.synthetic import FAULT_LEVEL_NAMES

from rock2d.commands.click_commands import ON_SCHEDULER, QUIET, SITE_COMMANDS
from rock2d.compiling import COMPILING, listening
from rock2d.files.text_files import DECIMAL_COMMA
from rock2d.interrupts import answer_signals, ignore_signals
from rock2d.schemas import SCHEMAS, file_schema


class Commands(click.Group):
    """Commands that refuse an option given twice, of which click would silently use the last value, and numbers that
    are not finite, and say what to write instead of a decimal comma."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        name, command, rest = super().resolve_command(ctx, args)
        if command is not None:
            own = click.Context(command, parent=ctx, info_name=name)
            values, _, given = command.make_parser(own).parse_args(list(rest))
            for option in given:
                if isinstance(option.type, (click.types.FloatParamType, click.Tuple, NumberOrGravity)):
                    for word in _words(values[option.name]):
                        if fault := _fault_of_number(word):
                            raise click.UsageError(f"{option.opts[0]}: {word!r} {fault}", own)
                single = isinstance(option, click.Option) and not (option.multiple or option.is_flag)
                if single and given.count(option) > 1:
                    raise click.UsageError(f"{option.opts[0]} is given {given.count(option)} times", own)
        return name, command, rest


def _words(value: Any) -> list[str]:
    return [value] if isinstance(value, str) else [word for part in value for word in _words(part)]


def _fault_of_number(word: str) -> str:
    """What is wrong with a number, beside its range; empty for other words, which click refuses."""
    if DECIMAL_COMMA.fullmatch(word):
        return f"has a decimal comma, write {word.replace(',', '.')}"
    with suppress(ValueError):
        return "" if math.isfinite(float(word)) else "is not a finite number"
    return ""


class NumberOrGravity(click.ParamType):
    """A positive number, or the word "gravity": then it is computed from the fall of the blocks."""

    name = f"number or {FROM_GRAVITY}"

    def __init__(self, largest: float) -> None:
        self._number = click.FloatRange(0, largest, min_open=True)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float | str:
        """The number, or the word."""
        return FROM_GRAVITY if value == FROM_GRAVITY else self._number.convert(value, param, ctx)


WORKERS = click.option("--workers", type=click.IntRange(1), help="Processes. Default: all cores.")
SCHEDULER = click.option("--scheduler", metavar="ADDRESS", help=f"Diagnoses {ON_SCHEDULER}")


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="rock2d")
def cli() -> None:
    """Rockfall against embankments in 2D: simulate, film, compare."""


for command in SITE_COMMANDS:
    cli.add_command(command)


@cli.command()
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/demo"), show_default=True,
              help="Folder for the page, figures, tables and the video.")  # fmt: skip
@QUIET
def demo(out, quiet) -> None:
    """The paper's three blocks with both models: Table 2 side by side with the paper, figures and a short video, on
    one page.

    Example: rock2d demo --out out/demo"""
    from rock2d_figures.demo import run_demo

    run_demo(out, progress=not quiet)


@cli.command()
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/reproduce"), show_default=True,
              help="Folder of the results.")  # fmt: skip
@click.option("--seed", type=click.IntRange(0, 2**63 - 1), default=1, show_default=True, help="Of every random draw.")
@click.option("--candidates", is_flag=True, help="Also try what physics each model may lack (several minutes more).")
@click.option("--hypotheses", type=click.IntRange(16), default=384, show_default=True,
              help="Hypotheses of each calibration.")  # fmt: skip
@click.option("--releases", type=click.IntRange(8), default=64, show_default=True,
              help="Releases of each block that test a hypothesis.")  # fmt: skip
@QUIET
def reproduce(out, seed, candidates, hypotheses, releases, quiet) -> None:
    """Make the paper's Tables 2 to 4 and Figures 1 to 3, and say where this project agrees better or worse with the
    experiment than the paper's models.

    Both models are calibrated on the sphere and on the statements of the text on first impacts. Each slope reduction
    is calibrated on its own block. Values that the paper does not publish are marginalised. An interrupted
    reproduction keeps the calibrations that it had finished.

    Example: rock2d reproduce --seed 1 --out out/reproduce"""
    from rock2d_figures.command import reproduce as run_reproduction

    from rock2d.reproduction.calibrations import Effort

    effort = Effort(hypotheses, releases)
    run_reproduction(out, seed=seed, effort=effort, candidates=candidates, progress=not quiet, report=click.echo)


@cli.command()
@click.argument("experiment", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), required=True,
              help="Folder for diagnosis.json and report.html.")  # fmt: skip
@click.option("--seed", type=click.IntRange(0, 2**63 - 1), default=0, show_default=True,
              help="Of the bootstrap intervals.")  # fmt: skip
@click.option("--workers", type=click.IntRange(1), help="Processes. Default: all cores. Results do not depend on it.")
@click.option("--limits", is_flag=False, flag_value="", type=click.Path(path_type=Path), metavar="[FOLDER]",
              help="Say which sizes of each effect would have been seen: from the study of rock2d blind inject in "
              "FOLDER, or as a linear model expects.")  # fmt: skip
@QUIET
def diagnose(experiment, out, seed, workers, limits, quiet) -> None:
    """Say where the simulation of EXPERIMENT (a folder) is wrong, which effect is missing, how far the gap shrinks.

    Every effect of the catalogue is fitted with the paper's law and tested on releases that the fit did not use.
    The same command continues an interrupted diagnosis.

    Example: rock2d diagnose my_tests --out diagnosis"""
    from rock2d.diagnosis.command import run_diagnosis

    run_diagnosis(experiment, out, seed=seed, workers=workers, limits=limits, progress=not quiet, report=click.echo)


@cli.command()
@click.argument("experiment", type=click.Path(path_type=Path))
@click.option("--diagnosis", type=click.Path(path_type=Path), required=True,
              help="Folder of a diagnosis, or its diagnosis.json.")  # fmt: skip
@click.option("--base-only", is_flag=True, help="The paper's law refitted, without the diagnosed effect.")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="CSV to write.")
def predict(experiment, diagnosis, base_only, out) -> None:
    """Predict every segment of EXPERIMENT from the measured flight before it, with a diagnosed model.

    Example: rock2d predict other_tests --diagnosis diagnosis/diagnosis.json --out predictions.csv"""
    from rock2d.diagnosis.command import run_prediction

    run_prediction(experiment, diagnosis, out, base_only=base_only, report=click.echo)


@cli.command()
@click.argument("a", type=click.Path(path_type=Path))
@click.argument("b", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), required=True,
              help="Folder for comparison.json and comparison.html.")  # fmt: skip
def compare(a, b, out) -> None:
    """Put two diagnoses A and B side by side; each is the folder of a diagnosis or its diagnosis.json.

    Says where verdicts, probabilities, parameters and places agree, and what of them cannot be compared.

    Example: rock2d compare before after --out comparison"""
    from rock2d.diagnosis.command import run_comparison

    run_comparison(a, b, out, report=click.echo)


@cli.group(cls=Commands)
def blind() -> None:
    """Test the diagnosis on films with a hidden cause, which an independent engine makes."""


@blind.command("make")
@click.option("--cases", type=click.IntRange(1, 10_000), default=200, show_default=True, help="Number of cases.")
@click.option("--seed", type=click.IntRange(0, 2**63 - 1), required=True, help="Seed of everything in it.")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder of the trial.")
@click.option("--base", "bases", type=click.Path(path_type=Path), multiple=True, metavar="EXPERIMENT",
              help="A real film that is the base of a share of the cases; may be given more than once.")  # fmt: skip
@WORKERS
@QUIET
def blind_make(cases, seed, out, bases, workers, quiet) -> None:
    """Make sealed cases: films with up to four hidden effects, or with a cause from outside the catalogue.

    Example: rock2d blind make --cases 40 --seed 1 --base my_tests --out trial"""
    from rock2d.blind.command import make

    make(cases, seed, out, bases, workers=workers, progress=not quiet, report=click.echo)


@blind.command("run")
@click.argument("trial", type=click.Path(path_type=Path))
@WORKERS
@SCHEDULER
@QUIET
def blind_run(trial, workers, scheduler, quiet) -> None:
    """Diagnose every case of TRIAL without its labels. The same command continues after an interruption.

    Example: rock2d blind run trial"""
    from rock2d.blind.command import run
    from rock2d.cluster import Workers

    run(trial, workers=Workers(workers, scheduler), progress=not quiet, report=click.echo)


@blind.command("score")
@click.argument("trial", type=click.Path(path_type=Path))
def blind_score(trial) -> None:
    """Open the labels of TRIAL and compare: score.html, score.json, score.csv.

    Example: rock2d blind score trial"""
    from rock2d.blind.command import score

    score(trial, report=click.echo)


@blind.command("inject")
@click.argument("experiment", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder of the study.")
@click.option("--effects", default="", metavar="NAME,...", help="Effects. Default: all that have a size.")
@click.option("--cases", type=click.IntRange(0, 10_000), default=6, show_default=True,
              help="Most diagnoses of films with a known cause; 0: what a linear model expects.")  # fmt: skip
@click.option("--sizes", default="seen50,seen90", show_default=True, metavar="SIZE,...",
              help="Sizes to put in: seen50, seen90, or multiples such as 2*seen90.")  # fmt: skip
@click.option("--seed", type=click.IntRange(0, 2**63 - 1), default=0, show_default=True,
              help="Of the order of the effects, and of what varies from impact to impact.")  # fmt: skip
@WORKERS
@SCHEDULER
@QUIET
def blind_inject(experiment, out, effects, cases, sizes, seed, workers, scheduler, quiet) -> None:
    """Put known causes into the film of EXPERIMENT: from which size on would the diagnosis see them?

    The same command continues after an interruption. `--limits` of `rock2d diagnose` takes the result into a report.

    Example: rock2d blind inject my_tests --out limits"""
    from rock2d.blind.command import inject
    from rock2d.blind.recovery import Plan, read_sizes
    from rock2d.cluster import Workers

    plan, chosen = Plan(cases, read_sizes(sizes), seed), Workers(workers, scheduler)
    inject(experiment, out, effects, plan, workers=chosen, progress=not quiet, report=click.echo)


@cli.command()
@click.argument("video", type=click.Path(path_type=Path))
@click.option("--config", type=click.Path(path_type=Path),
              help="setup.yaml: cross-section, blocks, camera with its true frame rate.")  # fmt: skip
@click.option("--metres-per-pixel", type=NumberOrGravity(10),
              help="Scale, without --config; gravity: computed from the fall of the blocks.")  # fmt: skip
@click.option("--fps", type=NumberOrGravity(1e7),
              help="Frames per second of the recording, without --config; gravity: computed from the fall of the "
              "blocks.")  # fmt: skip
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Experiment folder to write.")
@click.option("--frames", type=click.IntRange(1), help="Frames after which to stop. Default: all.")
@click.option("--explain", is_flag=True,
              help="Also write what moves in the film, and which keys to try. A film that cannot be tracked "
              "leaves this in any case.")  # fmt: skip
@QUIET
def track(video, config, metres_per_pixel, fps, out, frames, explain, quiet) -> None:
    """Track the blocks in a VIDEO and write an experiment folder with overlay video and page.

    Without --config, scale and frame rate are enough for a first track, which also writes a set-up file to refine.

    Example: rock2d track film.avi --config setup.yaml --out my_tests"""
    from rock2d_tracking.command import TrackSettings, track
    from rock2d_tracking.film_scale import FilmScale

    given = sum(value is not None for value in (metres_per_pixel, fps))
    if given != (2 if config is None else 0):
        raise click.UsageError("state either --config, or --metres-per-pixel and --fps")
    if metres_per_pixel == fps == FROM_GRAVITY:
        raise click.UsageError("gravity gives the frame rate or the scale, not both: state one of them")
    scale, rate = (None if value == FROM_GRAVITY else value for value in (metres_per_pixel, fps))
    known = config if config is not None else FilmScale(scale, rate)
    track(video, known, out, TrackSettings(frames, explain, progress=not quiet, report=click.echo))


@cli.command()
@click.argument("experiment", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Film to write (.avi).")
@click.option("--size", nargs=2, type=click.IntRange(64, 8192), default=(1280, 800), show_default=True,
              help="Width and height in px.")  # fmt: skip
@click.option("--faults", type=click.Choice(FAULT_LEVEL_NAMES), default="clean", show_default=True,
              help="Noise, blur, dust, shadow, burial, lost frames, compression ...")  # fmt: skip
@click.option("--releases", type=click.IntRange(1), help="Only the first ones.")
@click.option("--seed", type=click.IntRange(0, 2**63 - 1), default=0, show_default=True, help="Of the faults.")
@QUIET
def film(experiment, out, size, faults, releases, seed, quiet) -> None:
    """Draw a synthetic film of EXPERIMENT to test a tracker, and write its true positions and a set-up file.

    Example: rock2d film my_tests --out practice.avi --faults moderate"""
    from rock2d_tracking.command import FilmFormat, film

    film_format = FilmFormat(tuple(size), releases)
    film(experiment, out, film_format, faults=faults, seed=seed, progress=not quiet, report=click.echo)


@cli.command("import")
@click.argument("files", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--kind", type=click.Choice(importer_names()), required=True,
              help="Program that wrote the files, one for each film.")  # fmt: skip
@click.option("--config", type=click.Path(path_type=Path), required=True,
              help="setup.yaml; its scale and origin are in the files' unit of length.")  # fmt: skip
@click.option("--y", type=click.Choice(["up", "down"]), required=True, help="Where the files' y grows in the picture.")
@click.option("--block", help="Name of the block. Default: that of the set-up's releases, if they are of one.")
@click.option("--mark", "marks", multiple=True, help="Point on the block; two give its orientation.")
@click.option("--centroid", multiple=True, help="Points whose mean is the centroid. Default: the first mark.")
@click.option("--file-fps", type=float, help="Frames per unit of the files' time, if they number no frames.")
@click.option("--min-confidence", type=float, help="Points below it were not seen (DeepLabCut).")
@click.option("--gap-frames", type=click.IntRange(1), help="More lost frames than this separate releases.")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Experiment folder to write.")
def import_(files, kind, config, y, block, out, **options) -> None:
    """Write an experiment from FILES that another program tracked.

    Example: rock2d import points.txt --kind tracker --config setup.yaml --y up --out my_tests"""
    from rock2d_tracking.command import import_files
    from rock2d_tracking.importing import ImportOptions, TrackedFiles

    import_files(TrackedFiles(files, kind, y), config, out, ImportOptions(**options), block=block, report=click.echo)


@cli.command()
@click.argument("experiment", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Text file to write.")
def export(experiment, out) -> None:
    """Write the trajectories of EXPERIMENT for Tracker (Open Source Physics).

    Example: rock2d export my_tests --out tracker.txt"""
    from rock2d_tracking.command import export_tracker

    export_tracker(experiment, out, report=click.echo)


@cli.command()
@click.argument("kind", type=click.Choice(list(SCHEMAS)), default="scenario")
def schema(kind) -> None:
    """Print the JSON Schema of a KIND of file, for editors and other programs. Default: scenario.

    Example: rock2d schema scenario > scenario.schema.json"""
    import json

    click.echo(json.dumps(file_schema(kind), indent=2, ensure_ascii=False))


@cache  # print it once
def _print_compiling(begins: bool) -> None:
    """Tell the user that code is being compiled, unless the command is quiet."""
    context = click.get_current_context(silent=True)
    if begins and context is not None and not context.params.get("quiet"):
        click.echo(COMPILING, err=True)


def main() -> None:
    """Entry point. Exit codes: 2 for bad input, 3 for a failure of the machine, 130 for Ctrl-C, 143 for SIGTERM."""
    from rock2d.errors import InputError, print_warnings_in_one_line

    print_warnings_in_one_line()
    gc.set_threshold(10_000)  # to look for garbage, of which there is little, took a tenth of a short command
    terminated = answer_signals()
    # Matrices are small, so a second thread of linear algebra only costs time. This must be set before the import of
    # numpy, so that it holds for every library with its own BLAS, and for every worker.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        with listening(_print_compiling):
            cli(standalone_mode=False)
    except InputError as error:
        click.echo(f"error: {error}", err=True)
        sys.exit(2)
    except (OSError, MemoryError) as error:
        file = getattr(error, "filename", None)
        reason = getattr(error, "strerror", None) or str(error) or "not enough memory"
        click.echo(f"error: {file}: {reason}" if file else f"error: {reason}", err=True)
        sys.exit(3)
    except click.exceptions.Exit as stop:
        sys.exit(stop.exit_code)
    except click.ClickException as error:
        error.show()
        sys.exit(error.exit_code)
    except (KeyboardInterrupt, click.Abort) as stop:
        reason = str(stop) or str(stop.__cause__ or "")  # click raises its own exception from an interrupt
        what = "terminated" if terminated else "interrupted"
        click.echo(f"{what}: {reason or 'no half-written file is left'}", err=True)
        sys.exit(143 if terminated else 130)
    finally:  # a signal while Python ends would change the exit code
        ignore_signals()


if __name__ == "__main__":
    main()
