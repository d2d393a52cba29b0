"""From high-speed video to an experiment folder."""
