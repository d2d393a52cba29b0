"""The version of rock2d."""

__version__ = "0.1.0"
