"""How sure the results of a scenario are, and which embankment holds."""
