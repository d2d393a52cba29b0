"""The commands about a site: run, profile, soils."""
