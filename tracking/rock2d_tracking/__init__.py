"""From high-speed video to an experiment folder."""

FROM_GRAVITY = "gravity"  # stands for a scale or a frame rate that is computed from gravity
