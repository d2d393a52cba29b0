"""Synthetic films: experiments with known motion as a high-speed camera records them."""

FAULT_LEVEL_NAMES = ("clean", "moderate", "severe")
