"""Causes outside the catalogue of effects."""
