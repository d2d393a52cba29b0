"""What the commands about a site do: run, profile, soils."""
