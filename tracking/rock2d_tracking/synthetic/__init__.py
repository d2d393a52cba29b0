"""Synthetic films: experiments with known motion, as recorded by a high-speed camera."""

FAULT_LEVEL_NAMES = ("clean", "moderate", "severe")
