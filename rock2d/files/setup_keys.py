"""The keys that experiment and scenario files share: the cross-section and the blocks."""

from __future__ import annotations

import re
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag, model_validator

from rock2d.files.checked_yaml import Checked, did_you_mean, mistake, shown
from rock2d.scene.blocks import Block, make_block
from rock2d.scene.cross_section import CrossSection

LARGEST_M = 1.0e6
INERTIA_WORDS = ("solid_sphere", "uniform")


def _plain_name(name: str) -> str:
    if not name.strip() or name != name.strip() or not name.isprintable() or "," in name or '"' in name:
        raise mistake(f"expected a name without commas, quotes or spaces around it, found {shown(name)}")
    return name


Name = Annotated[str, AfterValidator(_plain_name)]
Coordinate = Annotated[float, Field(ge=-LARGEST_M, le=LARGEST_M)]
Point = Annotated[list[Coordinate], Field(min_length=2, max_length=2, description="[x, y] in m")]
Length = Annotated[float, Field(ge=1.0e-6, le=1.0e4)]


def _inertia(value: Any) -> Any:
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not (number and 0 < value < 1e30) and value not in INERTIA_WORDS:
        found = shown(value) + (did_you_mean(value, INERTIA_WORDS) if isinstance(value, str) else "")
        raise mistake(f"expected solid_sphere, uniform or a positive number in kg m², found {found}")
    return value


class CrossSectionKeys(Checked):
    """The ground, seen from the side."""

    points_m: list[Point] = Field(
        min_length=2, description="Surface polyline in m, left to right: [[x, y], ...], air above"
    )
    zones: list[Name] = Field(min_length=1, description="One zone name a facet: one fewer than points")
    measure_lines: dict[Name, list[Point]] = Field(
        default={}, description="Measure line name -> its two end points [[x, y], [x, y]] in m"
    )

    @model_validator(mode="after")
    def _makes_a_cross_section(self) -> CrossSectionKeys:
        # in steps, so that a complaint can be laid at the key that caused it
        try:
            CrossSection(self.points_m, ["z"] * (len(self.points_m) - 1))
        except ValueError as error:
            facet = re.search(r"facets? (\d+)(?: and (\d+))?", str(error))
            where = (int(facet[2] or facet[1]) + 1,) if facet else ()
            raise mistake(str(error), "points_m", *where) from None
        try:
            CrossSection(self.points_m, self.zones)
        except ValueError as error:
            raise mistake(str(error), "zones") from None
        for name, line in self.measure_lines.items():
            try:
                CrossSection(self.points_m, self.zones, {name: line})
            except ValueError as error:
                raise mistake(str(error), "measure_lines", name) from None
        return self

    def make(self) -> CrossSection:
        """The checked ground."""
        return CrossSection(self.points_m, self.zones, self.measure_lines)


class _BlockKeys(Checked):
    SIZES: ClassVar[tuple[str, ...]] = ()
    mass_kg: float = Field(ge=1.0e-9, le=1.0e12, description="Mass in kg")
    inertia: Annotated[Literal["solid_sphere", "uniform"] | float, BeforeValidator(_inertia)] = Field(
        default="uniform",
        description="Moment of inertia about the centroid: solid_sphere (2/5 m r²), uniform (prism of the "
        "profile), or a number in kg m²",
    )

    @model_validator(mode="after")
    def _makes_a_block(self) -> _BlockKeys:
        try:
            block = self.make("it")
        except (ValueError, ArithmeticError) as error:
            text = re.sub(r"^block it: ", "", str(error))
            key = [name for name in type(self).model_fields if name in text]
            raise mistake(text, *key[:1]) from None
        largest = block.mass_kg * block.radius_m**2
        if block.inertia_kg_m2 > largest * (1 + 1e-9):
            message = f"impossible: no block of this mass and size has more than {largest:.3g} kg m²"
            raise mistake(message, "inertia")
        return self

    def make(self, name: str) -> Block:
        """The block under this name."""
        return make_block(name, **self.model_dump())


class Circle(_BlockKeys):
    """A ball or disc."""

    shape: Literal["circle"] = Field(description="Profile of the block")
    diameter_m: Length = Field(description="Diameter in m")


class Square(_BlockKeys):
    """A square profile."""

    shape: Literal["square"] = Field(description="Profile of the block")
    side_m: Length = Field(description="Side in m")


class Rectangle(_BlockKeys):
    """A rectangular profile."""

    shape: Literal["rectangle"] = Field(description="Profile of the block")
    length_m: Length = Field(description="Length along the body's own x in m")
    height_m: Length = Field(description="Length along the body's own y in m")


class Ellipse(_BlockKeys):
    """An elliptic profile."""

    shape: Literal["ellipse"] = Field(description="Profile of the block")
    length_m: Length = Field(description="Axis along the body's own x in m")
    height_m: Length = Field(description="Axis along the body's own y in m")


class Polygon(_BlockKeys):
    """A convex polygon."""

    shape: Literal["polygon"] = Field(description="Profile of the block")
    vertices_m: list[Point] = Field(
        min_length=3, max_length=200, description="Corners [[x, y], ...] in m, convex, in order around"
    )


SHAPES = ("circle", "square", "rectangle", "ellipse", "polygon")


def _known_shape(value: Any) -> Any:
    if not isinstance(value, dict):
        raise mistake(f"expected a mapping (shape: ..., mass_kg: ...), found {shown(value)}")
    if "shape" not in value:
        raise mistake(f"missing key 'shape', one of {', '.join(SHAPES)}", at="key")
    if value["shape"] not in SHAPES:
        hint = did_you_mean(value["shape"], SHAPES)
        raise mistake(f"expected {', '.join(SHAPES)}, found {shown(value['shape'])}{hint}", "shape")
    return value


BlockKeys = Annotated[
    Annotated[Circle, Tag("<circle>")]
    | Annotated[Square, Tag("<square>")]
    | Annotated[Rectangle, Tag("<rectangle>")]
    | Annotated[Ellipse, Tag("<ellipse>")]
    | Annotated[Polygon, Tag("<polygon>")],
    Discriminator(lambda value: f"<{value['shape'] if isinstance(value, dict) else value.shape}>"),
    BeforeValidator(_known_shape),
]


def block_keys(block: Block) -> dict[str, Any]:
    """The keys from which `make_block` makes this block again."""
    keys: dict[str, Any] = {"shape": block.shape}
    if block.smooth:
        a, b = (2.0 * float(half) for half in block.semi_axes_m)
    else:
        a, b = (2.0 * float(half) for half in block.corners_m.max(axis=0))
    if block.shape == "circle":
        keys["diameter_m"] = a
    elif block.shape == "square":
        keys["side_m"] = a
    elif block.shape == "polygon":
        keys["vertices_m"] = [[float(x), float(y)] for x, y in block.corners_m]
    else:
        keys |= {"length_m": a, "height_m": b}
    keys["mass_kg"] = float(block.mass_kg)
    for inertia in ("uniform", "solid_sphere") if block.shape == "circle" else ("uniform",):
        if make_block(block.name, inertia=inertia, **keys).inertia_kg_m2 == block.inertia_kg_m2:
            return keys | {"inertia": inertia}
    return keys | {"inertia": float(block.inertia_kg_m2)}
