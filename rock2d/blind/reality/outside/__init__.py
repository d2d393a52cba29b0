"""Causes outside the catalogue of effects, one file each."""
