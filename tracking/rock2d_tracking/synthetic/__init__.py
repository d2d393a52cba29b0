"""Synthetic films: experiments of known motion as a high-speed camera would see them."""

FAULT_LEVEL_NAMES = ("clean", "moderate", "severe")
