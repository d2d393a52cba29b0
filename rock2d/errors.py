"""The error for bad input, with its codes, and the warnings about old files and unusual numbers.

A failure of the machine, for example a full disk, is an OSError; the command line exits with code 3.

Programs use `code` and the fields of an `InputError`; its message is for people. Codes are stable, messages are not.

======================  ===================================================================================
code                    meaning; fields beside file, line and column
======================  ===================================================================================
``bad_value``           a value that is not allowed (the code of an error that gives no other one)
``unknown_key``         a key of a YAML file, or a column of a table, that does not exist (``key``)
``missing_key``         a required key or column is not there (``key``)
``duplicate``           a key, column or file that is given twice (``key``)
``unknown_name``        a name of a zone, block, engine, table ... that does not exist (``name``)
``bad_cross_section``   points, zones or measure lines that make no cross-section (``facet`` where one is at fault)
``implausible``         a density, a size or an extent that no site has
``bad_block``           sizes, mass or inertia that make no block (``key``)
``bad_parameter``       a parameter for which a law makes no sense (``key``)
``bad_state``           a release that would start below the ground or outside the cross-section (``key``)
``not_yaml``            a file that is no YAML
``not_json``            a file that is no JSON
``not_text``            a file that is not UTF-8 text
``empty``               a file without content, or a selection without releases
``bad_table``           a table whose rows do not fit its header
``missing_file``        a file or folder that does not exist
``unreadable``          a file that exists and cannot be read
``outside_folder``      a path that leads out of its folder
``not_writable``        a file or folder that cannot be written
``not_a_result``        an output folder that holds something other than a result of rock2d
``results_exist``       an output folder that holds results, without the option that replaces them
``missing_data``        measured data that are not there (``folder``)
``wrong_kind``          an experiment, engine or option that does not fit together with the others
``missing_package``     an optional package that is not installed (``package``)
``no_cluster``          a Dask scheduler or its workers that do not answer or differ from this process
``not_diagnosed``       an experiment that fails the sanity checks of its film
======================  ==================================================================================="""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import Any

CODES = (
    "bad_value", "unknown_key", "missing_key", "duplicate", "unknown_name", "bad_cross_section", "implausible",
    "bad_block", "bad_parameter", "bad_state", "not_yaml", "not_json", "not_text", "empty", "bad_table", "missing_file",
    "unreadable", "outside_folder", "not_writable", "not_a_result", "results_exist", "missing_data", "wrong_kind",
    "missing_package", "no_cluster", "not_diagnosed",
)  # fmt: skip

MOST_LISTED = 8


class InputError(Exception):
    """The input of the user cannot be used. The message has the form "file:line:column: expected ..., found ...".

    The command line prints it and exits with code 2.

    Parameters
    ----------
    message : what is wrong, for a person
    file : where it is wrong
    line, column : where in the file, from 1
    code : what is wrong, for a program; one of `CODES`
    fields : further facts, see the table in `rock2d.errors`

    Attributes
    ----------
    message, file, line, column, code : as given
    fields : dict of the further facts

    Examples
    --------
    >>> error = InputError("unknown key", "scenario.yaml", 3, 1, code="unknown_key", key="engin")
    >>> print(error)
    scenario.yaml:3:1: unknown key
    >>> error.code, error.fields["key"]
    ('unknown_key', 'engin')"""

    def __init__(
        self,
        message: str,
        file: str | Path | None = None,
        line: int | None = None,
        column: int | None = None,
        *,
        code: str = "bad_value",
        **fields: Any,
    ) -> None:
        place = "".join(f"{part}:" for part in (file, line, column) if part is not None)
        super().__init__(f"{place} {message}" if place else message)
        self.message, self.file, self.line, self.column = message, file, line, column
        self.code, self.fields = code, fields


class OldKeyWarning(FutureWarning):
    """A file uses the former name of a key. The file is read nevertheless.

    Attributes
    ----------
    file, line : where the key stands; None for data that come from no file
    old, key : the former name and the name"""

    def __init__(self, message: str, file: str | Path | None, line: int | None, old: str, key: str) -> None:
        super().__init__(message)
        self.file, self.line, self.old, self.key = file, line, old, key


class UnusualWarning(UserWarning):
    """A number of an input is unusual. It is used nevertheless."""


def print_warnings_in_one_line() -> None:
    """Print warnings about input files in the form of error messages, without the line of code that raised them."""
    show = warnings.showwarning

    def print_warning(message: Any, category: type[Warning], *arguments: Any, **options: Any) -> None:
        if issubclass(category, (OldKeyWarning, UnusualWarning)):
            print(f"warning: {message}", file=sys.stderr)
        else:
            show(message, category, *arguments, **options)

    warnings.showwarning = print_warning


class ParameterError(ValueError):
    """A parameter for which a law makes no sense. `key` is its name."""

    def __init__(self, key: str, message: str) -> None:
        super().__init__(message)
        self.key, self.message = key, message

    def __reduce__(self) -> tuple[type[ParameterError], tuple[str, str]]:
        return type(self), (self.key, self.message)


def require(package: str, message: str) -> None:
    """Raise InputError if an optional package is not installed."""
    try:
        import_module(package)
    except ImportError:
        raise InputError(message, code="missing_package", package=package) from None


def counted(number: int, thing: str) -> str:
    """A number with its noun: `1 release`, `2 releases`."""
    return f"{number} {thing}{'' if number == 1 else 's'}"


def comma_list(things: Iterable[object]) -> str:
    """Comma-separated list, of at most MOST_LISTED things."""
    every = [str(thing) for thing in things]
    more = f" and {len(every) - MOST_LISTED} more" if len(every) > MOST_LISTED else ""
    return ", ".join(every[:MOST_LISTED]) + more
