"""The live view of a tracked film: its frames, one by one, as data for live_frames.js.

The script only computes positions on the screen; all other values are computed here.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from rock2d.errors import counted
from rock2d.graphics.live_data import in_page
from rock2d_tracking.frame_pictures import STILL_WIDTH_PX, FramePictures, frame_pictures, webp
from rock2d_tracking.looks import Looks
from rock2d_tracking.outline import Outline
from rock2d_tracking.reasons import REASONS
from rock2d_tracking.tracked_film import LARGEST_ERROR_RADII, LARGEST_STATED_ERROR_PX, TrackedFilm
from rock2d_tracking.velocities import MID_AIR

Array = np.ndarray

MOST_BYTES = 1_900_000  # of data in a page
MOST_FRAMES = 10_000  # in the view; each takes FRAME_BYTES in addition to its picture
FRAME_BYTES, TEXT_OF_BYTES = 120, 4 / 3  # of a frame without its picture; of base64 over what it holds
ELLIPSE_POINTS = 48
SHOWN_PER_S = 15.0  # approximate number of frames per second during playback
SPEEDS = (1.0, 0.5, 0.25, 0.1, 0.05, 0.025, 0.01, 0.005, 0.0025, 0.001)


@dataclass(frozen=True)
class LiveFrames:
    """The values for the template live_frames.html.j2.

    Attributes
    ----------
    data : JSON that holds no "<"
    releases : the text of each release in the selection
    speeds : playback speeds over real time; `speed` is the initial one
    notes : remarks on frames and pictures that are left out
    """

    data: str
    releases: Sequence[str]
    speeds: Sequence[float]
    speed: float
    notes: Sequence[str]


@dataclass(frozen=True)
class SeenFrames:
    """The frames of a film for its page.

    Attributes
    ----------
    table : `TrackedFilm.placed_frames`, the first MOST_FRAMES rows
    flight, impact : (n,) row of the flight and of the impact that each belongs to, -1 for none
    still : WebP of the first frame
    size_px : (width, height) of the film
    """

    table: pd.DataFrame
    flight: Array
    impact: Array
    pictures: FramePictures
    still: bytes
    size_px: tuple[int, int]


def seen_frames(
    film: Iterable[Array],
    table: pd.DataFrame,
    numbers: Array,
    looks: Mapping[str, Looks],
    motion: tuple[pd.DataFrame, pd.DataFrame],
    still: Array,
) -> SeenFrames:
    """The frames with their pictures.

    film : read once more, from the start
    table : `TrackedFilm.placed_frames`
    numbers : (n,) of each row in the film
    motion : tables of flights and impacts
    """
    shown = table.iloc[:MOST_FRAMES]
    flight, impact = belonging(shown, *motion)
    radii = shown["block"].map({name: np.sqrt(own.outline.area_px2 / np.pi) for name, own in looks.items()})
    important = ((shown["reason"] != "") | (impact >= 0)).to_numpy(bool)
    room = (MOST_BYTES - FRAME_BYTES * len(shown)) / TEXT_OF_BYTES
    pictures = frame_pictures(
        film, numbers[: len(shown)], _places(shown), radii.to_numpy(float), important, int(room)
    )
    size_px = (still.shape[1], still.shape[0])
    return SeenFrames(shown, flight, impact, pictures, webp(still, STILL_WIDTH_PX), size_px)


def belonging(frames: pd.DataFrame, flights: pd.DataFrame, impacts: pd.DataFrame) -> tuple[Array, Array]:
    """(n,) row of the flight of each frame, and of the impact between whose flights the frame is; -1 for none."""
    release, t = frames["release"].to_numpy(), frames["t_s"].to_numpy(float)
    flight, impact = np.full(len(frames), -1), np.full(len(frames), -1)
    for k, own in enumerate(_records(flights)):
        flight[(release == own.release) & (t > own.begin_s - 1e-9) & (t < own.end_s + 1e-9)] = k
    for k, own in enumerate(_records(impacts)):
        same = flights[flights["release"] == own.release].sort_values("begin_s")
        begin, end = same["begin_s"].to_numpy(float), same["end_s"].to_numpy(float)
        after = int(np.searchsorted(0.5 * (begin + end), own.t_s))  # the first flight whose middle is later
        if 0 < after < len(same):
            between = (t > end[after - 1] - 1e-9) & (t < begin[after] + 1e-9)
            impact[(release == own.release) & between] = k
    return flight, impact


def _records(table: pd.DataFrame) -> list[Any]:
    return list(table.itertuples())


def _places(frames: pd.DataFrame) -> Array:
    """(n, 2) place of the block in the picture, interpolated where it is lost."""
    places = frames[["u_px", "v_px"]].to_numpy(float, copy=True)
    for _, rows in frames.groupby("release").indices.items():
        known = rows[np.isfinite(places[rows, 0])]
        for k in (0, 1):
            places[rows, k] = np.interp(rows, known, places[known, k])
    return places


def live_frames(
    seen: SeenFrames,
    film: TrackedFilm,
    looks: Mapping[str, Looks],
    flights: pd.DataFrame,
    impacts: pd.DataFrame,
) -> LiveFrames:
    """The live view of a tracked film."""
    table, fps = seen.table, film.experiment.fps
    groups = table.groupby("release", sort=False)
    names = list(dict.fromkeys(table["block"]))
    reasons = list(dict.fromkeys(table["reason"]))
    data = {
        "size": seen.size_px, "still": _text(seen.still),
        "blocks": [_block(name, looks[name]) for name in names],
        "reasons": [[reason, REASONS.get(reason, "").replace("`", "")] for reason in reasons],
        "releases": [
            [int(own["release"].iloc[0]), names.index(own["block"].iloc[0]), len(own)] for number, own in groups
        ],
        "frames": _columns(table, reasons, film) | {"flight": seen.flight.tolist(), "impact": seen.impact.tolist()},
        "flights": _flight_texts(flights), "impacts": _impact_texts(impacts),
        "pictures": {
            "rows": seen.pictures.rows.tolist(), "boxes": seen.pictures.boxes_px.tolist(),
            "images": list(map(_text, seen.pictures.images)),
        },
    }  # fmt: skip
    words = [
        f"{number}: {own['block'].iloc[0]}, {counted(len(own), 'frame')}, {(own['reason'] != '').sum()} lost"
        for number, own in groups
    ]
    speeds = [speed for speed in SPEEDS if speed * fps >= 1.0] or [1.0]
    speed = next((speed for speed in speeds if speed * fps <= SHOWN_PER_S), speeds[-1])
    return LiveFrames(in_page(data), words, speeds, speed, _notes(seen, len(film.frames)))


def _text(raw: bytes) -> str:
    return base64.b64encode(raw).decode()


def _block(name: str, looks: Looks) -> dict[str, Any]:
    """Name, outline about the centroid in px, and why its frames are trusted."""
    radius = float(np.sqrt(looks.outline.area_px2 / np.pi))
    limit = max(LARGEST_STATED_ERROR_PX, LARGEST_ERROR_RADII * radius)
    how = (
        "correlation with the learned picture" if looks.kind == "picture" else "of the outline seen as fitted"
    )
    points = np.round(_polygon(looks.outline), 3).tolist()
    return {"name": name, "outline": points, "how": how, "limit": f"{limit:.3g}"}


def _polygon(outline: Outline) -> Array:
    if len(outline.edges):
        return outline.corners_px
    turn = np.linspace(0.0, 2 * np.pi, ELLIPSE_POINTS, endpoint=False)
    return np.column_stack([np.cos(turn), np.sin(turn)]) * outline.semi_axes_px


def _columns(table: pd.DataFrame, reasons: Sequence[str], film: TrackedFilm) -> dict[str, list[Any]]:
    """Columns of the frames; None where there is no number."""
    places = {"x_m": 7, "y_m": 7, "theta_rad": 5}
    pixels = {"u_px": 4, "v_px": 4, "angle_px_rad": 5}
    errors = ("u_error_px", "v_error_px", "angle_error_rad")
    columns = {name: _numbers(table[name], f".{digits}f") for name, digits in (places | pixels).items()}
    columns |= {name: _numbers(table[name], ".3g") for name in errors}
    columns |= {"t_s": _numbers(table["t_s"], ".9g"), "confidence": _numbers(table["confidence"], ".3f")}
    return columns | {
        "frame": table["frame"].astype(int).tolist(), "reason": [reasons.index(own) for own in table["reason"]],
    }  # fmt: skip


def _numbers(values: pd.Series, form: str) -> list[float | None]:
    return [float(f"{value:{form}}") if np.isfinite(value) else None for value in values.astype(float)]


def _flight_texts(flights: pd.DataFrame) -> list[str]:
    texts = []
    order = flights.groupby("release").cumcount() + 1
    of = flights.groupby("release")["release"].transform("size")
    for k, own in enumerate(_records(flights)):
        gravity = (
            f"; g = {own.gravity_m_s2:.3g} ± {own.gravity_m_s2_se:.2g} m/s²" if own.gravity_m_s2 > 0 else ""
        )
        texts.append(
            f"{order.iloc[k]} of {of.iloc[k]}: {own.begin_s:.4g} to {own.end_s:.4g} s, {counted(own.frames, 'frame')}"
            f"; residuals {own.misfit:.2f} times the noise{gravity}"
        )
    return texts


def _impact_texts(impacts: pd.DataFrame) -> list[str]:
    texts = []
    order = impacts.groupby("release").cumcount() + 1
    for k, own in enumerate(_records(impacts)):
        if own.flag == MID_AIR:
            texts.append(f"at {own.t_s:.4g} s the motion changes in mid-air: no impact")
            continue
        ratio = (
            f"restitution {own.restitution:.3f} ± {own.restitution_se:.2g}"
            if np.isfinite(own.restitution)
            else "no restitution"
        )
        flag = f"; flag: {own.flag}" if own.flag else ""
        texts.append(f"{order.iloc[k]}: at {own.t_s:.4g} s on {own.zone}, {ratio}{flag}")
    return texts


def _notes(seen: SeenFrames, frames: int) -> list[str]:
    """Remarks on frames and pictures that are not on the page."""
    shown, pictures = len(seen.table), len(seen.pictures.rows)
    notes = [f"This view shows the first {shown} of {frames} frames."] if shown < frames else []
    if pictures == shown:
        return [*notes, "Every frame has its picture, cut out about the block."]
    return [
        *notes,
        f"{pictures} of {shown} frames have a picture: one in {seen.pictures.stride}, and more of the lost ones and of "
        "those between two flights. The overlay video and frames.csv have all.",
    ]
