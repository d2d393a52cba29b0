"""Blind tests of the diagnosis: films of a set-up that the diagnosis knows nothing of but the files."""
