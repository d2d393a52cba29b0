"""The command line. Heavy imports happen inside the commands, so that `rock2d --help` is instant."""

from __future__ import annotations

import sys
from pathlib import Path

import click

ENGINE = click.Choice(["pymunk", "batch", "point_mass"])


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="rock2d")
def cli() -> None:
    """Rockfall against embankments in 2D: simulate, film, compare."""


@cli.command()
@click.argument("scenarios", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--engine", "engines", multiple=True, type=ENGINE, help="Engine; may be given twice.")
@click.option("--seed", type=click.IntRange(0, 2**63 - 1), help="Seed instead of the scenario's.")
@click.option("--releases", type=click.IntRange(1), help="Releases of each block instead of the scenario's.")
@click.option("--out", type=click.Path(path_type=Path), default=Path("out"), show_default=True,
              help="Folder under which each run gets its own.")  # fmt: skip
@click.option("--data", type=click.Path(path_type=Path), envvar="ROCK2D_DATA",
              help="Folder of measured data (or the variable ROCK2D_DATA).")  # fmt: skip
@click.option("--video", is_flag=True, help="Also film the first releases.")
@click.option("--workers", type=click.IntRange(1), help="Processes; all cores by default.")
@click.option("--quiet", is_flag=True, help="No progress bar.")
def run(scenarios, engines, seed, releases, out, data, video, workers, quiet) -> None:
    """Run SCENARIOS (YAML) and write experiment folders, tables and figures."""
    from rock2d.report import print_tables
    from rock2d.run import simulate, write_results
    from rock2d.scenario import load_scenario

    loaded = [load_scenario(path, data) for path in scenarios]
    for scenario in loaded:
        for engine in engines or [scenario.engine]:
            result = simulate(
                scenario, engine=engine, seed=seed, releases=releases, workers=workers, progress=not quiet
            )
            folder = out / f"{scenario.name}_{engine}"
            tables = write_results(result, folder, video=video, progress=not quiet)
            print_tables(result, tables)
            click.echo(f"written: {folder}")


@cli.command()
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/demo"), show_default=True,
              help="Folder for figures, tables and the video.")  # fmt: skip
@click.option("--quiet", is_flag=True, help="No progress bar.")
def demo(out, quiet) -> None:
    """The paper's three blocks with both models: figures, a table and a short video."""
    from rock2d.demo import run_demo

    run_demo(out, progress=not quiet)


@cli.command()
def schema() -> None:
    """Print the JSON Schema of a scenario file, for editors."""
    import json

    from rock2d.scenario import scenario_json_schema

    click.echo(json.dumps(scenario_json_schema(), indent=2, ensure_ascii=False))


def main() -> None:
    """Entry point: bad input is one message and exit code 2, an interrupt 130."""
    from rock2d.errors import InputError

    try:
        cli(standalone_mode=False)
    except InputError as error:
        click.echo(f"error: {error}", err=True)
        sys.exit(2)
    except click.exceptions.Exit as stop:
        sys.exit(stop.exit_code)
    except click.ClickException as error:
        error.show()
        sys.exit(error.exit_code)
    except (KeyboardInterrupt, click.Abort):
        click.echo("interrupted: nothing half-written was left", err=True)
        sys.exit(130)


if __name__ == "__main__":
    main()
