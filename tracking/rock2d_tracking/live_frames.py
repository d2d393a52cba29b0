"""The live view of a tracked film: its frames, one by one, as data for live_frames.js.

The script only computes positions on the screen; all other values are computed here."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from rock2d.arrays import Array
from rock2d.errors import counted
from rock2d.graphics.live_data import MOST_BYTES, in_page
from rock2d_tracking.film_tables import MID_AIR
from rock2d_tracking.looks import Looks
from rock2d_tracking.outline import Outline
from rock2d_tracking.sights import REASONS
from rock2d_tracking.tracked_film import LARGEST_STATED_ERROR_PX, LARGEST_STATED_ERROR_RADII, TrackedFilm

MOST_FRAMES = 10_000  # in the view; each takes FRAME_BYTES in addition to its picture
FRAME_BYTES, TEXT_OF_BYTES = 120, 4 / 3  # of a frame without its picture; of base64 over what it holds
ELLIPSE_POINTS = 48
SHOWN_PER_S = 15.0  # approximate number of frames per second during playback
SPEEDS = (1.0, 0.5, 0.25, 0.1, 0.05, 0.025, 0.01, 0.005, 0.0025, 0.001)
HALF_RADII, LEAST_HALF_PX = 3.0, 20  # half the side of a picture, in radii of the block, and its minimum
LARGEST_SIDE_PX = 160  # larger pictures are reduced
QUALITY = 75  # of WebP, 0 to 100
MOST_TRIED = 2500  # most pictures that are made to find how many fit
IMPORTANT_RATIO = 8  # important frames are shown this many times as often as others
STILL_WIDTH_PX = 720


@dataclass(frozen=True)
class LiveFrames:
    """The values for the template live_frames.html.j2.

    Attributes
    ----------
    data : JSON that holds no "<"
    releases : the text of each release in the selection
    speeds : playback speeds over real time; `speed` is the initial one
    notes : remarks on frames and pictures that are left out"""

    data: str
    releases: Sequence[str]
    speeds: Sequence[float]
    speed: float
    notes: Sequence[str]


def flight_and_impact_rows(frames: pd.DataFrame, flights: pd.DataFrame, impacts: pd.DataFrame) -> tuple[Array, Array]:
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
    frames: Iterable[Array], film: TrackedFilm, numbers: Array, looks: Mapping[str, Looks], still: Array
) -> LiveFrames:
    """The live view of a tracked film.

    frames : the pictures of the film, read once more, from the start
    numbers : (n,) of each row of `film.frames` in the file
    still : (height, width) the first picture"""
    table, fps = film.frames.iloc[:MOST_FRAMES], film.experiment.fps
    flight, impact = flight_and_impact_rows(table, film.flights, film.impacts)
    names = list(dict.fromkeys(table["block"]))
    pictures = frame_pictures(
        frames, numbers[: len(table)], _places(table),
        table["block"].map({name: looks[name].outline.radius_px for name in names}).to_numpy(float),
        important=((table["reason"] != "") | (impact >= 0)).to_numpy(bool),
        most_bytes=int((MOST_BYTES - FRAME_BYTES * len(table)) / TEXT_OF_BYTES),
    )  # fmt: skip
    groups = table.groupby("release", sort=False)
    reasons = list(dict.fromkeys(table["reason"]))
    data = {
        "size": still.shape[::-1], "still": _text(webp(still, STILL_WIDTH_PX)),
        "blocks": [_block(name, looks[name]) for name in names],
        "reasons": [[reason, REASONS.get(reason, "").replace("`", "")] for reason in reasons],
        "releases": [
            [int(own["release"].iloc[0]), names.index(own["block"].iloc[0]), len(own)] for number, own in groups
        ],
        "frames": _columns(table, reasons) | {"flight": flight.tolist(), "impact": impact.tolist()},
        "flights": _flight_texts(film.flights), "impacts": _impact_texts(film.impacts),
        "pictures": {
            "rows": pictures.rows.tolist(), "boxes": pictures.boxes_px.tolist(),
            "images": list(map(_text, pictures.images)),
        },
    }  # fmt: skip
    words = [
        f"{number}: {own['block'].iloc[0]}, {counted(len(own), 'frame')}, {(own['reason'] != '').sum()} lost"
        for number, own in groups
    ]
    speeds = [speed for speed in SPEEDS if speed * fps >= 1.0] or [1.0]
    speed = next((speed for speed in speeds if speed * fps <= SHOWN_PER_S), speeds[-1])
    return LiveFrames(in_page(data), words, speeds, speed, _notes(pictures, len(table), len(film.frames)))


def _text(raw: bytes) -> str:
    return base64.b64encode(raw).decode()


def _block(name: str, looks: Looks) -> dict[str, Any]:
    """Name, outline about the centroid in px, and why its frames are trusted."""
    limit = max(LARGEST_STATED_ERROR_PX, LARGEST_STATED_ERROR_RADII * looks.outline.radius_px)
    how = "correlation with the learned picture" if looks.kind == "picture" else "of the outline seen as fitted"
    points = np.round(_polygon(looks.outline), 3).tolist()
    return {"name": name, "outline": points, "how": how, "limit": f"{limit:.3g}"}


def _polygon(outline: Outline) -> Array:
    if len(outline.edges):
        return outline.corners_px
    turn = np.linspace(0.0, 2 * np.pi, ELLIPSE_POINTS, endpoint=False)
    return np.column_stack([np.cos(turn), np.sin(turn)]) * outline.semi_axes_px


def _columns(table: pd.DataFrame, reasons: Sequence[str]) -> dict[str, list[Any]]:
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
        gravity = f"; g = {own.gravity_m_s2:.3g} ± {own.gravity_m_s2_se:.2g} m/s²" if own.gravity_m_s2 > 0 else ""
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


def _notes(pictures: FramePictures, shown: int, frames: int) -> list[str]:
    """Remarks on frames and pictures that are not on the page; `shown`: number of the frames that are."""
    notes = [f"This view shows the first {shown} of {frames} frames."] if shown < frames else []
    own = len(pictures.rows)
    if own == shown:
        return [*notes, "Every frame has its picture, cut out about the block."]
    return [
        *notes,
        f"{own} of {shown} frames have a picture: one in {pictures.stride}, and more of the lost ones and "
        "of those between two flights. The overlay video and frames.csv have all.",
    ]


class FramePictures(NamedTuple):
    """Pictures of some frames.

    Attributes
    ----------
    stride : every `stride`-th frame is shown, of those that are not important
    rows : (n,) of the table of frames
    boxes_px : (n, 4) left, top, width and height of each in the film
    images : WebP"""

    stride: int
    rows: Array
    boxes_px: Array
    images: list[bytes]


def frame_pictures(
    film: Iterable[Array], numbers: Array, places_px: Array, radii_px: Array, important: Array, most_bytes: int
) -> FramePictures:
    """Pictures of as many frames as fit into `most_bytes`.

    numbers : (n,) of each row in the film
    places_px : (n, 2) centres of the pictures
    radii_px : (n,) of the blocks
    important : (n,) which rows are preferred"""
    stride = 1
    while shown_rows(important, stride).sum() > MOST_TRIED:
        stride *= 2
    wanted = np.flatnonzero(shown_rows(important, stride))
    made = _cut_out(film, wanted, numbers, places_px, radii_px)
    sizes = np.zeros(len(important))
    sizes[list(made)] = [len(image) for _, image in made.values()]
    while stride < len(important) and sizes[shown_rows(important, stride)].sum() > most_bytes:
        stride *= 2
    kept = [row for row in np.flatnonzero(shown_rows(important, stride)).tolist() if row in made]
    boxes = np.array([made[row][0] for row in kept]).reshape(-1, 4)
    return FramePictures(stride, np.array(kept, int), boxes, [made[row][1] for row in kept])


def shown_rows(important: Array, stride: int) -> Array:
    """(n,) which rows have a picture."""
    number = np.arange(len(important))
    return (number % stride == 0) | (important & (number % max(1, stride // IMPORTANT_RATIO) == 0))


def _cut_out(
    film: Iterable[Array], wanted: Array, numbers: Array, places_px: Array, radii_px: Array
) -> dict[int, tuple[Array, bytes]]:
    """Row -> its box and picture."""
    rows_of: dict[int, list[int]] = {}
    for row in wanted.tolist():
        rows_of.setdefault(int(numbers[row]), []).append(row)
    last, made = max(rows_of, default=-1), {}
    for number, frame in enumerate(film):
        for row in rows_of.get(number, ()):
            half = max(round(HALF_RADII * radii_px[row]), LEAST_HALF_PX)
            middle = np.round(places_px[row]).astype(int)
            low = np.clip(middle - half, 0, np.array(frame.shape[1::-1]) - 1)
            high = np.clip(middle + half + 1, low + 1, frame.shape[1::-1])
            part = frame[low[1] : high[1], low[0] : high[0]]
            made[row] = (np.concatenate([low, high - low]), webp(part, LARGEST_SIDE_PX))
        if number == last:
            break
    return made


def webp(picture: Array, largest_px: int) -> bytes:
    """A picture as WebP, reduced so that no side is longer than `largest_px`."""
    import cv2

    scale = min(1.0, largest_px / max(picture.shape[:2]))
    size = (max(1, round(picture.shape[1] * scale)), max(1, round(picture.shape[0] * scale)))
    if scale < 1.0:
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    return bytes(cv2.imencode(".webp", np.ascontiguousarray(picture), [cv2.IMWRITE_WEBP_QUALITY, QUALITY])[1])
