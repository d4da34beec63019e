"""Options that several commands share, and their checks."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal, TypeVar, get_args

import typer

# The same names as in models.reconstruct and models.patterns, which are not imported here: torch and numpy take
# a second to load, and --help must not wait for them. A test holds both lists together.
MethodName = Literal["nstep", "wft", "wavelet1d", "wavelet2d", "shearlet", "refiner"]
MatchingName = Literal["stereo", "trinocular"]
PlanChoice = Literal["composite", "reference", "full", "complementary", "calibration"]
RasterChoice = Literal["square", "diamond"]
METHODS: tuple[MethodName, ...] = get_args(MethodName)
MATCHINGS: tuple[MatchingName, ...] = get_args(MatchingName)
Name = TypeVar("Name", bound=str)


def names_from(text: str, known: tuple[Name, ...], option: str) -> tuple[Name, ...]:
    """The known names in a list with commas, each once; raises a usage error for others."""
    words = [word.strip() for word in text.split(",")]
    unknown = [word for word in words if word not in known]
    if unknown:
        raise typer.BadParameter(f"'{unknown[0]}' is not one of {', '.join(known)}", param_hint=option)
    return tuple(known[known.index(word)] for word in dict.fromkeys(words))


def _check_range(value: tuple[float, float] | None) -> tuple[float, float] | None:
    if value is not None and not (all(math.isfinite(v) for v in value) and 0 < value[0] < value[1]):
        raise typer.BadParameter(f"MIN must be positive and below MAX, got {value[0]:g} {value[1]:g}")
    return value


Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON on stdout.")]
DepthRange = Annotated[
    tuple[float, float] | None,
    typer.Option(
        metavar="MIN MAX",
        callback=_check_range,
        help="Depths in mm; points outside are invalid. Default: the common working volume of the calibration.",
    ),
]
Matching = Annotated[
    MatchingName | None,
    typer.Option(help="Two cameras, or the projector as well. Default: trinocular where it is calibrated."),
]
Calibration = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="calibration.json or OpenCV YAML/XML, in place of the copy in the capture."),
]
Plan = Annotated[PlanChoice, typer.Option(help="Which patterns.")]
Workers = Annotated[int, typer.Option(min=1, help="Processes that share the work.")]
