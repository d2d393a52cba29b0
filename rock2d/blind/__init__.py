"""Blind tests of the diagnosis: films of a bench that the diagnosis knows nothing of but the files."""
