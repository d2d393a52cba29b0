"""Blind tests of the diagnosis: films with hidden causes, of which the diagnosis sees only the files."""
