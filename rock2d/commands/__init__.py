"""The commands about a site: run, profile, design, soils."""
