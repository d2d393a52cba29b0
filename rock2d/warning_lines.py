"""Warnings about input files, as the command line prints them."""

from __future__ import annotations

import warnings

import click

from rock2d.errors import OldKeyWarning


def print_warnings_in_one_line() -> None:
    """Let a warning about an input file look like an error message: without the place in rock2d's own code."""
    show = warnings.showwarning

    def print_warning(message, category, *arguments, **options) -> None:
        if issubclass(category, OldKeyWarning):
            click.echo(f"warning: {message}", err=True)
        else:
            show(message, category, *arguments, **options)

    warnings.showwarning = print_warning
