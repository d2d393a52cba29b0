"""Campaigns: runs of so many releases that they are computed in chunks, without full tracks."""

OUTPUTS = ("ends", "crossings", "impacts", "samples")  # what a campaign can keep of each release
DEFAULT_OUTPUTS = ("ends", "crossings")
