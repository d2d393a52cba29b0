"""Why a frame is lost: the words of `frames.csv`, and what they mean."""

from __future__ import annotations

REASONS = {
    "no fit": "No pose of the outline agrees with the frame.",
    "no contrast": "The block has the grey of its background.",
    "hidden": "Too little of the outline is visible (`detection: least_seen`).",
    "half hidden": "So little of the outline is visible that soil can look like its edge (less than 1.25 × "
    "`least_seen`); the block is followed, but the frame is not used.",
    "another outline": "The visible object has another size or shape.",
    "another picture": "The correlation with the learned picture is too low.",
    "too far from the expected place": "Something beside the path of the block was fitted.",
    "unsure": "The standard error of the position is larger than 1 px, and than 0.05 radii of the block.",
    "on the background": "The outline holds much less than usual of what differs from the background.",
    "like a shadow": "What moves darkens the background evenly, and its outline is not sharp.",
    "out of the picture": "The block has left the picture.",
    "jumps": "The pose is far from the path through its neighbours, or its flight does not begin where the one before "
    "ends.",
    "marks not recognised": "The turn of a marked circle does not follow from the frame before.",
}
