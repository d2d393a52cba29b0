"""Draw the cross-section with its zones, measure lines and names, and blocks, on pixel images."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from rock2d.arrays import Array
from rock2d.graphics.canvas import (
    PIXEL_FRACTION_BITS,
    Viewport,
    bgr,
    draw_text,
    fill,
    fixed_point,
    in_image,
    polyline,
    text_size,
)
from rock2d.graphics.palette import DEEP_GROUND, INK, LEADER_INK, LINE_INK, NAME_INK, SKY, mixed, zone_tones
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection

Box = tuple[float, float, float, float]  # left, top, right, bottom in px

SHADES = 64  # shades of a tone, from the surface to the deep ground
BUSY_PX = 3  # paths this near to the name of a measure line count as crossing it
LABEL_TURNS_RAD = (0.0, 0.5, -0.5, 1.0, -1.0, 1.6, -1.6, 2.2, -2.2)  # from the direction of the line
LABEL_LEVELS = 4


def ground_image(cross_section: CrossSection, view: Viewport, depth_px: float, *, surface_px: float = 2.0) -> Array:
    """The cross-section as a BGR image (height_px, width_px, 3): sky, ground, surface line.

    Down to about `depth_px`, the ground has the tone of the zone of the nearest facet; this also holds at vertical
    facings and overhangs."""
    pad = int(1.8 * depth_px) + 2
    surface = view.pixels(cross_section.points_m) + pad
    canvas = (view.height_px + 2 * pad, view.width_px + 2 * pad)
    seen = np.s_[pad : pad + view.height_px, pad : pad + view.width_px]
    zones = zone_tones(cross_section.zone_names)
    ids = np.full(canvas, len(zones), np.int32)
    for i, zone in enumerate(cross_section.zone_ids):
        cv2.polylines(ids, [fixed_point(surface[i : i + 2])], False, (int(zone),), 1, cv2.LINE_8, PIXEL_FRACTION_BITS)
    on_line = ids < len(zones)
    if on_line.any():
        depth, label = cv2.distanceTransformWithLabels(
            (~on_line).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
        )
        zone_of = np.zeros(int(label.max()) + 1, np.int32)
        zone_of[label[on_line]] = ids[on_line]
        near, depth = zone_of[label[seen]], depth[seen]
    else:
        near, depth = np.zeros(ids[seen].shape, np.int32), np.full(ids[seen].shape, np.inf, np.float32)

    floor = np.array([[surface[-1, 0], canvas[0] + pad], [surface[0, 0], canvas[0] + pad]])
    inside = np.zeros(canvas, np.uint8)
    cv2.fillPoly(inside, [fixed_point(np.vstack([surface, floor]))], 1, cv2.LINE_8, PIXEL_FRACTION_BITS)

    # the colours of each zone by depth, then the colour of the sky
    level = np.clip((1.6 - depth / depth_px) * (SHADES - 1), 0, SHADES - 1).astype(np.int32)
    share = np.linspace(0.0, 1.0, SHADES)[:, None]
    shades = [share * bgr(tone) + (1 - share) * bgr(DEEP_GROUND) for tone in zones.values()]
    colours = np.rint(np.vstack([*shades, bgr(SKY)])).astype(np.uint8)
    image = colours[np.where(inside[seen], near * SHADES + level, len(colours) - 1)]
    # smooths the borders between tones
    image = np.asarray(cv2.GaussianBlur(image, (3, 3), 0), np.uint8)
    polyline(image, view.pixels(cross_section.points_m), INK, surface_px)
    return image


def draw_measure_lines(image: Array, cross_section: CrossSection, view: Viewport, thick_px: float) -> None:
    """Draw the measure lines, dashed."""
    for line in cross_section.measure_lines.values():
        a, b = view.pixels(line)
        length = float(np.hypot(*(b - a)))
        dash = max(2.0, 4.0 * thick_px)
        for start in np.arange(0.0, length, 2 * dash):
            ends = np.array([start, min(start + dash, length)])[:, None] / length
            polyline(image, a + ends * (b - a), LINE_INK, thick_px)


@dataclass(frozen=True)
class PlacedName:
    """A name with the box of its text and, if it is away from its object, a leader line."""

    text: str
    box: Box
    colour: str
    leader_px: Array | None = None


def placed_names(
    cross_section: CrossSection, view: Viewport, size_px: int, avoid_px: Array | None = None
) -> list[PlacedName]:
    """Places for the names of zones (below the surface) and of measure lines (near their ends, if possible away from
    the points `avoid_px` (n, 2)). The name of a zone is left out if there is no room."""
    names: list[PlacedName] = []
    taken: list[Box] = []
    gap = 0.4 * size_px
    surface = view.pixels(cross_section.points_m)
    bounds = (gap, gap, view.width_px - gap, view.height_px - gap)
    for zone, at in _visible_runs(cross_section, surface, view):
        text = zone.replace("_", " ")
        size = text_size(text, size_px)
        x = float(np.clip(at[0] - 0.5 * size[0], bounds[0], bounds[2] - size[0]))
        y = _lowest(surface, x, x + size[0], at[1]) + 1.2 * gap
        box = (x, y, x + size[0], y + size[1])
        while any(_overlap(box, other, 0.5 * gap) for other in taken):
            y += 0.5 * size_px
            box = (x, y, x + size[0], y + size[1])
        if box[3] > bounds[3]:
            continue
        taken.append(box)
        apart = y - at[1] > 1.5 * size_px
        leader = np.array([[at[0], at[1] + 0.4 * gap], [at[0], y - 0.1 * gap]]) if apart else None
        names.append(PlacedName(text, box, NAME_INK, leader))
    busy = np.empty((0, 2)) if avoid_px is None else avoid_px
    for text, ends in _line_names(cross_section, view, size_px):
        box = _measure_line_box(ends, surface, text_size(text, size_px), gap, taken, bounds, busy)
        taken.append(box)
        names.append(PlacedName(text, box, LINE_INK))
    return names


def draw_names(image: Array, names: Sequence[PlacedName], size_px: int) -> None:
    """Draw names; names of measure lines, which are in the air, have a halo."""
    for name in names:
        if name.leader_px is not None:
            polyline(image, name.leader_px, LEADER_INK, 1.0)
        halo = SKY if name.colour == LINE_INK else None
        draw_text(image, name.box[:2], name.text, size_px, name.colour, halo=halo)


def draw_block(
    image: Array, view: Viewport, block: Block, pose: Sequence[float], colour: str, style: str = "solid"
) -> None:
    """Draw `block` at `pose` (x_m, y_m, theta_rad), "solid", "ghost" (translucent) or "hollow" (outline).

    A solid block has an orientation mark: a pale half and a dot on a smooth profile, a pale corner on a polygon."""
    x, y, theta = pose
    turn = np.array([[np.cos(theta), np.sin(theta)], [-np.sin(theta), np.cos(theta)]])

    def placed(body: Array) -> Array:
        return view.pixels(body @ turn + (x, y))

    edge = placed(block.outline(64))
    if not in_image(edge, image):
        return
    size = block.size_m * view.px_per_m
    line_px = float(np.clip(size / 28, 1.0, 3.0))
    if style == "ghost":
        veil = image.copy()
        fill(veil, edge, colour)
        cv2.addWeighted(veil, 0.3, image, 0.7, 0, dst=image)
        polyline(image, edge, colour, max(line_px, 1.5), closed=True)
        return
    if style == "hollow":
        polyline(image, edge, mixed(colour, SKY, 0.35), line_px, closed=True)
        return
    fill(image, edge, colour)
    pale = mixed(colour, "#ffffff", 0.75)
    if block.smooth:
        half = np.array(block.semi_axes_m) * 0.86
        angle = np.linspace(0.0, np.pi, 33)
        fill(image, placed(np.column_stack([np.cos(angle), np.sin(angle)]) * half), pale)
        dot = np.array([0.62 * block.semi_axes_m[0], 0.0])
        radius = 0.16 * min(block.semi_axes_m)
    else:
        corners = block.corners_m
        to_next, to_last = corners[1] - corners[0], corners[-1] - corners[0]
        reach = 0.62 * min(np.hypot(*to_next), np.hypot(*to_last))
        tip = [to_next / np.hypot(*to_next) * reach, 0 * to_next, to_last / np.hypot(*to_last) * reach]
        fill(image, placed(corners[0] * 0.88 + np.array(tip) * 0.88), pale)
        dot, radius = np.zeros(2), 0.05 * block.size_m
    angle = np.linspace(0.0, 2 * np.pi, 20)
    if size > 12:
        spot = dot + radius * np.column_stack([np.cos(angle), np.sin(angle)])
        fill(image, placed(spot), mixed(colour, "#000000", 0.45))
    polyline(image, edge, mixed(colour, "#000000", 0.45), line_px, closed=True)


def _overlap(a: Box, b: Box, gap: float = 0.0) -> bool:
    return a[0] < b[2] + gap and b[0] < a[2] + gap and a[1] < b[3] + gap and b[1] < a[3] + gap


def _visible_runs(cross_section: CrossSection, surface: Array, view: Viewport) -> list[tuple[str, Array]]:
    """Zone name and anchor (middle of the visible part, px) of each run of facets of one zone."""
    import shapely

    facets = shapely.linestrings(np.stack([surface[:-1], surface[1:]], axis=1))
    seen = shapely.clip_by_rect(facets, 0.0, 0.0, view.width_px, view.height_px)
    found = []
    for zone, run in itertools.groupby(zip(cross_section.zones, seen, strict=True), key=lambda facet: facet[0]):
        path = shapely.get_coordinates([part for _, part in run])
        if len(path) > 1:
            along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
            middle = np.array([np.interp(0.5 * along[-1], along, path[:, k]) for k in (0, 1)])
            found.append((zone, middle))
    return found


def _lowest(surface: Array, left: float, right: float, default: float) -> float:
    """Lowest point (largest row) of the surface between two columns."""
    import shapely

    low, high = surface[:, 1].min() - 1.0, surface[:, 1].max() + 1.0
    between = shapely.clip_by_rect(shapely.linestrings(surface), left, low, right, high)
    return float(shapely.get_coordinates(between)[:, 1].max(initial=default))


def _line_names(cross_section: CrossSection, view: Viewport, near_px: float) -> list[tuple[str, Array]]:
    """Name and ends (px) of each measure line; upright lines that lie within `near_px` share one name."""
    groups: list[tuple[list[str], Array]] = []
    for name, line in sorted(cross_section.measure_lines.items(), key=lambda own: float(own[1][:, 0].min())):
        ends = view.pixels(line)
        if groups and np.abs(groups[-1][1][:, 0] - ends[:, 0]).max() < near_px:
            groups[-1][0].append(name)
        else:
            groups.append(([name], ends))
    return [(", ".join(names).replace("_", " "), ends) for names, ends in groups]


def _measure_line_box(
    ends: Array, surface: Array, size: tuple[float, float], gap: float, taken: Sequence[Box], bounds: Box, busy: Array
) -> Box:
    """The box for the name of a measure line: near the end farther from the ground, away from other names and from
    the points `busy` (n, 2)."""
    away = [_distance(surface, end) for end in ends]
    tip, root = (ends[0], ends[1]) if away[0] >= away[1] else (ends[1], ends[0])
    along = (tip - root) / max(1e-9, float(np.hypot(*(tip - root))))
    level_px = 1.2 * size[1]  # names of neighbouring lines are placed one above the other
    # no place of the name reaches farther from the tip
    reach = gap + sum(size) + LABEL_LEVELS * level_px + BUSY_PX
    busy_x, busy_y = busy[(np.abs(busy[:, 0] - tip[0]) < reach) & (np.abs(busy[:, 1] - tip[1]) < reach)].T.copy()
    best, least = None, np.inf
    for order, (level, turn) in enumerate(itertools.product(range(LABEL_LEVELS), LABEL_TURNS_RAD)):
        c, s = np.cos(turn), np.sin(turn)
        way = np.array([c * along[0] - s * along[1], s * along[0] + c * along[1]])
        far = gap + level * level_px + 0.5 * (abs(way[0]) * size[0] + abs(way[1]) * size[1])
        x, y = tip + way * far
        box = (x - 0.5 * size[0], y - 0.5 * size[1], x + 0.5 * size[0], y + 0.5 * size[1])
        outside = box[0] < bounds[0] or box[1] < bounds[1] or box[2] > bounds[2] or box[3] > bounds[3]
        hidden = _lowest(surface, box[0], box[2], -1e9) < box[3]  # reaches into the ground
        on_line = _distance(ends, np.array([x, y])) < 0.6 * size[1]
        cost = 1e6 * outside + 1e5 * sum(_overlap(box, other) for other in taken) + 1e4 * (hidden or on_line)
        cost += order
        if cost >= least:
            continue  # crossed paths only add to the cost
        left, top, right, bottom = box[0] - BUSY_PX, box[1] - BUSY_PX, box[2] + BUSY_PX, box[3] + BUSY_PX
        crossed = (busy_x > left) & (busy_x < right) & (busy_y > top) & (busy_y < bottom)
        cost += 10.0 * min(int(crossed.sum()), 500)
        if cost < least:
            best, least = box, cost
    assert best is not None
    return best


def _distance(line: Array, point: Array) -> float:
    import shapely

    return float(shapely.distance(shapely.linestrings(line), shapely.points(point)))
