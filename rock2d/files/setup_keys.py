"""The keys that experiment and scenario files share: the cross-section and the blocks."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag, create_model, model_validator

from rock2d.errors import UnusualWarning
from rock2d.files.checked_yaml import Checked, Document, did_you_mean, mistake, shown
from rock2d.files.places import is_number
from rock2d.scene.blocks import Block, make_block
from rock2d.scene.cross_section import CrossSection, CrossSectionError
from rock2d.scene.earthworks import DitchSizes, EmbankmentSizes
from rock2d.scene.plausibility import block_doubts
from rock2d.scene.shapes import inertia_words, shapes
from rock2d.scene.shapes.shape import BlockError, Shape

FARTHEST_M = 1.0e6
MOST_CORNERS = 200
LONGEST_NAME = 100
INERTIA_WORDS = inertia_words()


def plain_name(name: str) -> str:
    """The name of a zone, a block or a line; raises a `mistake` for a name that tables and messages cannot hold."""
    if len(name) > LONGEST_NAME:
        raise mistake(f"expected a name of at most {LONGEST_NAME} characters, found {shown(name)}")
    if not name.strip() or name != name.strip() or not name.isprintable() or "," in name or '"' in name:
        raise mistake(f"expected a name without commas, quotes or spaces around it, found {shown(name)}")
    return name


Name = Annotated[str, AfterValidator(plain_name)]
Coordinate = Annotated[float, Field(ge=-FARTHEST_M, le=FARTHEST_M)]
Point = Annotated[list[Coordinate], Field(min_length=2, max_length=2, description="[x, y] in m")]
Length = Annotated[float, Field(ge=1.0e-6, le=1.0e4)]
Steepness = Annotated[float, Field(ge=2.0, le=90.0)]  # in degrees; a right angle in rad is less than 2


def _inertia(value: Any) -> Any:
    if not (is_number(value) and 0 < value < 1e30) and value not in INERTIA_WORDS:
        found = shown(value) + (did_you_mean(value, INERTIA_WORDS) if isinstance(value, str) else "")
        raise mistake(f"expected {', '.join(INERTIA_WORDS)} or a positive number in kg m², found {found}")
    return value


class CrossSectionKeys(Checked):
    """The ground, seen from the side."""

    points_m: list[Point] = Field(
        min_length=2, description="Surface polyline in m, left to right: [[x, y], ...], air above"
    )
    zones: list[Name] = Field(min_length=1, description="One zone name per facet: n - 1 names for n points")
    measure_lines: dict[Name, list[Point]] = Field(
        default={}, description="Measure line name -> its two end points [[x, y], [x, y]] in m"
    )

    @model_validator(mode="after")
    def _makes_a_cross_section(self) -> CrossSectionKeys:
        try:
            self.make()
        except CrossSectionError as error:
            where: tuple[str | int, ...] = (error.key,)
            if error.key == "points_m" and error.facet is not None:
                where += (error.facet + 1,)  # the facet's end
            elif error.line is not None:
                where += (error.line,)
            raise mistake(
                str(error), *where, code="bad_cross_section", facet=error.facet, line_name=error.line
            ) from None
        return self

    def make(self) -> CrossSection:
        """The checked ground."""
        return CrossSection(self.points_m, self.zones, self.measure_lines)


class EmbankmentKeys(Checked):
    """An embankment on the natural ground; zones uphill_face, crest, downhill_face and measure lines follow."""

    x_m: Coordinate = Field(description="Uphill foot, on the natural ground, in m")
    height_m: Length = Field(description="Height of the crest above the natural ground at the foot, in m")
    crest_m: Length = Field(description="Width of the crest in m")
    uphill_deg: Steepness = Field(description="Slope of the facing in degrees; 90 is vertical")
    downhill_deg: Steepness = Field(description="Slope of the back in degrees; 90 is vertical")

    def make(self) -> EmbankmentSizes:
        """The sizes."""
        return EmbankmentSizes(**self.model_dump())


class DitchKeys(Checked):
    """A ditch with a level bottom before the embankment; its zone is ditch."""

    width_m: Length = Field(description="Width of the bottom in m")
    depth_m: Annotated[float, Field(ge=0, le=1.0e4)] = Field(
        default=0.0, description="Depth of the bottom below the natural ground at the embankment's foot, in m"
    )
    uphill_deg: Steepness = Field(description="Slope of the uphill wall in degrees; 90 is vertical")

    def make(self) -> DitchSizes:
        """The sizes."""
        return DitchSizes(**self.model_dump())


def _one_or_several(value: Any) -> str:
    """Tag of the form of `embankment` or `ditch` in a file: the sizes of one, or number -> sizes."""
    several = isinstance(value, dict) and any(isinstance(own, (dict, Checked)) for own in value.values())
    return "<several>" if several else "<one>"


def _numbers_from_1(value: Any) -> Any:
    for key in value:
        if key not in map(str, range(1, len(value) + 1)):
            message = "embankments are numbered 1, 2, 3, ... from uphill to downhill, without a gap"
            raise mistake(message, key, at="key", code="unknown_key", key=key)
    return value


OneOrSeveral = Discriminator(_one_or_several)
Several = Tag("<several>")
Embankments = Annotated[
    Annotated[EmbankmentKeys, Tag("<one>")]
    | Annotated[dict[str, EmbankmentKeys], BeforeValidator(_numbers_from_1), Several],
    OneOrSeveral,
]
Ditches = Annotated[Annotated[DitchKeys, Tag("<one>")] | Annotated[dict[str, DitchKeys], Several], OneOrSeveral]


class _BlockModel(Checked):
    """The keys of every block; those of its shape come from `rock2d.scene.shapes`."""

    mass_kg: float = Field(ge=1.0e-9, le=1.0e12, description="Mass in kg")
    inertia: Annotated[Literal[INERTIA_WORDS] | float, BeforeValidator(_inertia)] = Field(  # type: ignore[valid-type]
        default="uniform",
        description="Moment of inertia about the centroid: solid_sphere (2/5 m r²), uniform (prism of the "
        "profile), or a number in kg m²",
    )

    @model_validator(mode="after")
    def _makes_a_block(self) -> _BlockModel:
        try:
            block = self.make("it")
        except BlockError as error:
            path = () if error.key is None else (error.key,)
            raise mistake(error.reason, *path, code="bad_block") from None
        except (ValueError, ArithmeticError) as error:
            raise mistake(f"impossible sizes: {error}", code="bad_block") from None
        largest = block.mass_kg * block.radius_m**2
        if block.inertia_kg_m2 > largest * (1 + 1e-9):
            message = f"impossible: no block of this mass and size has more than {largest:.3g} kg m²"
            raise mistake(message, "inertia", code="bad_block")
        return self

    def make(self, name: str) -> Block:
        """The block under this name."""
        return make_block(name, **self.model_dump())


def _model(shape: Shape) -> type[_BlockModel]:
    """The keys of a block of this shape."""
    own: dict[str, Any] = {"shape": (Literal[shape.name], Field(description="Profile of the block"))}
    for size in shape.sizes:
        limits: Any = {"min_length": 3, "max_length": MOST_CORNERS} if size.points else {}
        kind = list[Point] if size.points else Length
        own[size.key] = (kind, Field(description=size.meaning, **limits))
    return create_model(shape.name.capitalize(), __base__=_BlockModel, __doc__=shape.summary, **own)


def _known_shape(value: Any) -> Any:
    if not isinstance(value, dict):
        raise mistake(f"expected a mapping (shape: ..., mass_kg: ...), found {shown(value)}")
    known = list(shapes())
    if "shape" not in value:
        raise mistake(f"missing key 'shape', one of {', '.join(known)}", at="key", code="missing_key", key="shape")
    if value["shape"] not in known:
        hint = did_you_mean(value["shape"], known)
        message = f"expected {', '.join(known)}, found {shown(value['shape'])}{hint}"
        raise mistake(message, "shape", code="unknown_name")
    return value


_MODELS = {name: _model(shape) for name, shape in shapes().items()}
globals().update({model.__name__: model for model in _MODELS.values()})  # pickle looks for them here

if TYPE_CHECKING:
    BlockKeys = _BlockModel
else:
    BlockKeys = Annotated[
        Union[tuple(Annotated[model, Tag(f"<{name}>")] for name, model in _MODELS.items())],  # noqa: UP007
        Discriminator(lambda value: f"<{value['shape'] if isinstance(value, dict) else value.shape}>"),
        BeforeValidator(_known_shape),
    ]


def block_keys(block: Block) -> dict[str, Any]:
    """The keys of a block in a file; `make_block` makes the same block from them."""
    shape = shapes()[block.shape]
    keys: dict[str, Any] = {"shape": block.shape, **shape.sizes_of(block.semi_axes_m, block.corners_m)}
    keys["mass_kg"] = float(block.mass_kg)
    for inertia in shape.inertias:
        if make_block(block.name, inertia=inertia, **keys).inertia_kg_m2 == block.inertia_kg_m2:
            return keys | {"inertia": inertia}
    return keys | {"inertia": float(block.inertia_kg_m2)}


def warn_of_impossible_blocks(document: Document, blocks: Mapping[str, Block], ground: CrossSection) -> None:
    """Warn of blocks of a density or size that nothing has, because of a wrong unit. What is only unusual on a slope,
    such as a ball of steel, is usual in a film."""
    for doubt in (doubt for block in blocks.values() for doubt in block_doubts(block, ground)):
        if doubt.impossible:
            warnings.warn(UnusualWarning(str(document.error(doubt.text, *doubt.key, at="key"))), stacklevel=3)
