"""What a campaign can keep of each release."""

from __future__ import annotations

OUTPUTS = ("ends", "crossings", "impacts", "samples")
DEFAULT_OUTPUTS = ("ends", "crossings")
