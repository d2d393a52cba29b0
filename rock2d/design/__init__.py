"""Uncertainty of the results of a scenario, size of embankments, and report."""
