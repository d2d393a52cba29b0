"""The table that the benchmarks print: what they noted under `rows`, not the times of whole rounds."""

from __future__ import annotations

import pytest


def pytest_configure(config):
    config.option.benchmark_quiet = True  # pytest-benchmark's own table


@pytest.hookimpl(optionalhook=True)
def pytest_benchmark_update_machine_info(machine_info):
    machine_info.pop("node", None)  # the name of the machine says nothing


def pytest_terminal_summary(terminalreporter, config):
    session = getattr(config, "_benchmarksession", None)
    for bench in session.benchmarks if session else ():
        terminalreporter.section(bench.name, sep="-")
        for row in bench.extra_info.get("rows", ()):
            value, low, high = (f"{row[key]:.4g}" for key in ("value", "low", "high"))
            line = f"{row['what']:<58}{value:>10} {row['unit']:<12}{low} to {high}"
            terminalreporter.write_line(f"{line}  {row.get('note', '')}".rstrip())
