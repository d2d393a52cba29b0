"""The ways to run a release: pymunk (reference), batch (compiled ensembles), point_mass (probabilistic)."""
