"""What the benchmarks print: what they noted under `rows`, and one table of what they noted under `waits`."""

import pytest


def pytest_configure(config):
    config.option.benchmark_quiet = True  # pytest-benchmark's own table


@pytest.hookimpl(optionalhook=True)
def pytest_benchmark_update_machine_info(machine_info):
    machine_info.pop("node", None)  # the name of the machine says nothing


@pytest.hookimpl(optionalhook=True, tryfirst=True)
def pytest_benchmark_compare_machine_info():
    """Ratios may come from another machine: no warning."""


def pytest_terminal_summary(terminalreporter, config):
    session = getattr(config, "_benchmarksession", None)
    if session is None:
        return
    for bench in session.benchmarks:
        if rows := bench.extra_info.get("rows"):
            terminalreporter.section(bench.name, sep="-")
        for row in rows or ():
            value, low, high = (f"{row[key]:.4g}" for key in ("value", "low", "high"))
            line = f"{row['what']:<58}{value:>10} {row['unit']:<12}{low} to {high}"
            terminalreporter.write_line(f"{line}  {row.get('note', '')}".rstrip())
    waits = [wait for bench in session.benchmarks for wait in bench.extra_info.get("waits", ())]
    before = {
        (wait["what"], wait["of"]): wait["ratio"]
        for benches in (session.compared_mapping or {}).values()
        for bench in benches.values()
        for wait in bench["extra_info"].get("waits", ())
    }
    if waits:
        print_waits(terminalreporter, waits, before)


def print_waits(terminalreporter, waits, before):
    """The table of waits, with the ratios of an earlier run, by what was measured and what it is compared with."""
    terminalreporter.section("what a person waits for")
    head = f"{'':<58}{'seconds':>10}{'n':>4}{'ratio':>11} {'to':<11}"
    terminalreporter.write_line(head + f"{'before':>10}{'now/before':>12}" * bool(before))
    for wait in waits:
        line = f"{wait['what']:<58}{wait['seconds']:>10.3g}{wait['n']:>4}{wait['ratio']:>11.3g} {wait['of']:<11}"
        if then := before.get((wait["what"], wait["of"])):
            line += f"{then:>10.3g}{wait['ratio'] / then:>12.2f}"
        terminalreporter.write_line(line.rstrip())
