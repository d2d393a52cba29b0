"""From a scenario to results: conditions of each release, engines, indicators, campaigns."""
