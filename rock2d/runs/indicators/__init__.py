"""Indicators: what the modules of this folder define as `INDICATOR`, or as `INDICATORS`.

An indicator is a table that is computed from the tracks of a run. `rock2d run` writes it, and `RunResult.to_pandas`
returns it."""
