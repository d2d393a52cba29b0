"""Explanation of a tracking result: a film with the candidates, counts of reasons, and keys to try next."""

from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rock2d.arrays import Array
from rock2d.files.folders import write_whole
from rock2d.graphics.video_file import VideoWriter
from rock2d.kinematics.film_findings import with_error
from rock2d.kinematics.flight_gravity import Measured
from rock2d.kinematics.flights import FEWEST_FLIGHT_FRAMES
from rock2d_tracking.arcs import Arc, mean_acceleration
from rock2d_tracking.film_scale import Proposal, proposal
from rock2d_tracking.following import Follower
from rock2d_tracking.motion import Motion
from rock2d_tracking.overlay import put_text, reduced, reduced_size

PICTURE_WIDTH_PX, PICTURES, PLAYED_FPS = 640, 400, 15.0
OTHER_BGR, SHADOW_BGR, FALL_BGR, BLOCK_BGR = (255, 255, 255), (200, 120, 60), (0, 200, 255), (60, 200, 60)
SIZE_AGREES = 0.15  # largest relative difference between the visible and the stated size
GRAVITY_AGREES = 0.1
PARTLY_HIDDEN = "detection.least_seen: lower it (now {least:g}) if blocks are partly hidden and the overlay looks right"
KEY_OF_REASON = {
    "hidden": PARTLY_HIDDEN,
    "half hidden": PARTLY_HIDDEN,
    "no contrast": "detection.background_frames: name frames without a block, or film before another colour",
    "on the background": "detection.background_frames: name frames without a block",
    "another outline": "blocks: the outline that is seen is not the one that is stated; check shape and sizes",
    "another picture": "blocks: what is seen changes its look; state its shape and sizes",
    "unsure": "camera.scale: film closer, or with more light and a shorter exposure; the outline is not sharp enough",
    "too far from the expected place": "camera.fps: more frames per second; the block moves farther than expected",
    "jumps": "camera.fps: more frames per second; the block moves farther than expected",
}  # key of the set-up file that addresses each reason for which frames are lost
USUAL_KEYS = (
    "detection.background_frames: name frames without a block, if it rests in the picture for long",
    PARTLY_HIDDEN,
    "camera.origin_px: with cross_section it says where the ground is; a block below the ground is not seen",
    "camera.fps: frames per second of the recording, not of the playback",
)
FEWEST_CURVED = 8  # least frames of an arc whose curvature is reported


class TrackingAttempt(NamedTuple):
    """A film, the motion in it, and what followed its blocks, if there were any."""

    frames: Iterable[Array]
    motion: Motion
    follower: Follower | None = None


def write_explanation(folder: Path, seen: TrackingAttempt, said: str) -> None:
    """Write `candidates.webm`, `candidates.png` and `explanation.txt` into a folder; `said`: the result of tracking."""
    _draw(folder, seen.frames, seen.motion)
    lines = [said, "", *_counts(seen), "", "Keys to try next:"]
    lines += [f"{k}. {text}" for k, text in enumerate(keys_to_try(seen), 1)]
    write_whole(folder / "explanation.txt", "\n".join(lines) + "\n")


def _counts(seen: TrackingAttempt) -> list[str]:
    _, motion, follower = seen
    number = [len(c) for c in motion.candidates]
    falls, other = sum(a.falls for a in motion.arcs), sum(a.falls_otherwise for a in motion.arcs)
    lines = [
        f"frames: {len(number)}; candidates in a frame: {np.median(number) if number else 0:g} (median), "
        f"{sum(own['shadow'].sum() for own in motion.candidates)} look like shadows",
        f"arcs: {len(motion.arcs)}; {falls} fall as gravity does, {other} are bent otherwise, the others are straight",
        f"releases that arcs show: {len(motion.chains)}",
    ]
    for k, chain in enumerate(motion.chains):
        ratios = [f"{a.gravity_ratio:.3f}" for a in chain.arcs if a.falls]
        lines.append(
            f"  {k}: frames {chain.first} to {chain.last}, {chain.frames_seen} of them with a candidate, radius "
            f"{chain.radius_px:.1f} px, acceleration over gravity {', '.join(ratios)}"
        )
    if follower is None:
        return lines
    for name, looks in follower.looks.items():
        lines.append(
            f"block {name}: fitted by its {looks.kind}; seen {looks.size:.3f} times as large as stated"
            + (f" (± {looks.size_error:.3f})" if np.isfinite(looks.size_error) else " (not measured)")
        )
    reasons = follower.lost_frames()
    reasons["trusted"] = sum(len(r.seen) for r in follower.releases)
    lines += [f"frames {reason}: {count}" for reason, count in reasons.most_common()]
    return lines


def keys_to_try(seen: TrackingAttempt) -> list[str]:
    """Three keys of the set-up file, the most helpful first, each with the evidence from the film."""
    _, motion, follower = seen
    setup = follower.setup if follower is not None else None
    found: list[str] = []
    long = [a for a in motion.arcs if len(a.frames) >= FEWEST_CURVED]
    curved = [a for a in long if a.falls] or [a for a in long if a.falls_otherwise]  # what slides is bent otherwise
    if curved:
        best = max(curved, key=lambda a: len(a.frames) * a.contrast)
        ratio = best.gravity_ratio
        if abs(ratio - 1.0) > GRAVITY_AGREES and ratio > 0:
            would = proposed(motion, curved)
            found.append(
                f"camera.fps: what falls accelerates {ratio:.3g} times as fast as gravity; if the scale is right, the "
                f"frame rate is {with_error(would.fps)}, or write fps: gravity"
            )
            found.append(
                f"camera.scale: if the frame rate is right, a pixel is {would.metres_per_pixel.value:.4g} m, "
                f"{1 / ratio:.3g} times as large as stated"
            )
        elif ratio < 0:
            found.append("camera.up: what moves on parabolas falls toward the top of the picture")
    areas = [c.area_px2 for c in motion.chains] or [a.area_px2 for a in motion.arcs if a.falls]
    sizes = [float(np.sqrt(a / np.pi)) for a in areas]
    if setup is not None and sizes:
        usual_px = float(np.median(sizes))
        for name, block in setup.blocks.items():
            stated = block.size_m / 2 / setup.metres_per_pixel
            if abs(usual_px / stated - 1.0) > SIZE_AGREES:
                found.append(
                    f"blocks.{name}: what falls has a radius of {usual_px:.1f} px "
                    f"({usual_px * setup.metres_per_pixel:.4g} m); the set-up file states {stated:.1f} px "
                    f"({stated * setup.metres_per_pixel:.4g} m)"
                )
    least = setup.keys.detection.least_seen if setup is not None else 0.55
    reasons = [reason for reason, _ in follower.lost_frames().most_common()] if follower is not None else []
    wanted = [*(KEY_OF_REASON[r] for r in reasons if r in KEY_OF_REASON), *USUAL_KEYS]
    found += [text.format(least=least) for text in dict.fromkeys(wanted)]
    first = {text.split(":")[0]: text for text in reversed(found)}
    return [text for text in found if first[text.split(":")[0]] is text][:3]


def proposed(motion: Motion, arcs: Sequence[Arc]) -> Proposal:
    """Frame rate and scale with which some arcs have the acceleration of gravity; both must be stated."""
    fall, g = mean_acceleration(arcs), motion.scale.g_px_frame2
    return proposal(motion.scale, Measured(abs(fall.value) / g, fall.error / g))


def why_not_tracked(follower: Follower) -> str:
    """A message for a film in which no release can be trusted."""
    reasons = ", ".join(f"{reason!r} {count}" for reason, count in follower.lost_frames().most_common(3))
    sights = max((r.sights for r in follower.releases), key=len, default=[])
    if sights:
        trusted = sum(not s.reason for s in sights)
        errors = [max(s.error[:2]) for s in sights if np.isfinite(s.error[:2]).all()]
        known = f"; its place is known to {np.median(errors):.2g} px (median)" if errors else ""
        lost = f"; lost frames: {reasons}" if reasons else ""
        return (
            f"a block was followed from frame {sights[0].frame} to {sights[-1].frame}, but in {len(sights)} frames "
            f"{trusted} can be trusted and show it move: {FEWEST_FLIGHT_FRAMES} are needed{known}{lost}"
        )
    chains = follower.motion.chains
    if chains:
        chain = max(chains, key=lambda c: c.frames_seen)
        return (
            f"something falls in frames {chain.first} to {chain.last}, with a radius of "
            f"{chain.radius_px:.1f} px, but the block of the set-up file was fitted in none of them"
            + (f": {reasons}" if reasons else "")
        )
    return (
        "no block was seen to move in this film; check in the set-up file the scale, the sizes of the blocks, "
        "the place of the cross-section in the picture (origin_px, origin_m) and the direction `up`"
    )


def _draw(folder: Path, film: Iterable[Array], motion: Motion) -> None:
    import cv2

    still: Array | None = None
    stride = max(1, len(motion.candidates) // PICTURES)
    with ExitStack() as stack:
        for number, frame in enumerate(film):
            if number % stride or number >= len(motion.candidates):
                continue
            scale, size = reduced_size((frame.shape[1], frame.shape[0]), PICTURE_WIDTH_PX)
            picture = reduced(frame, size)
            if still is None:
                writer = stack.enter_context(VideoWriter(folder / "candidates.webm", PLAYED_FPS, size))
                still = picture.copy()
                _draw_arcs(still, motion, scale)
            for c in motion.candidates[number]:
                radius = max(2, int(np.sqrt(c["area_px2"] / np.pi) * scale) + 2)
                at = (c["place_px"] * scale).astype(int).tolist()
                cv2.circle(picture, at, radius, SHADOW_BGR if c["shadow"] else OTHER_BGR, 1, cv2.LINE_AA)
            chain = motion.chain_at(number)
            place = chain.at(number) if chain is not None else None
            if place is not None:
                at = (place * scale).astype(int).tolist()
                cv2.drawMarker(picture, at, BLOCK_BGR, cv2.MARKER_CROSS, 14, 1)
            put_text(picture, f"frame {number}", (8, 18), 0.45)
            writer.write(picture)
    if still is not None:
        cv2.imwrite(str(folder / "candidates.png"), still)


def _draw_arcs(picture: Array, motion: Motion, scale: float) -> None:
    """Draw every arc: those of blocks green, other falls yellow, the rest white."""
    import cv2

    own = {id(a) for c in motion.chains for a in c.arcs}
    for arc in motion.arcs:
        colour = BLOCK_BGR if id(arc) in own else FALL_BGR if arc.falls else OTHER_BGR
        line = np.round(arc.at(np.linspace(arc.first, arc.last, 60)) * scale).astype(np.int32)
        cv2.polylines(picture, [line], False, colour, 1, cv2.LINE_AA)
        for u, v in arc.places * scale:
            cv2.circle(picture, (int(u), int(v)), 2, colour, 1, cv2.LINE_AA)
