"""Plans on the command line where several may be named."""

from __future__ import annotations

from typing import Annotated, get_args

import typer

from service.cli.options import PlanChoice, names_from

ALL = "all"
PLANS: tuple[PlanChoice, ...] = get_args(PlanChoice)
_DEFAULT: tuple[PlanChoice, ...] = ("full",)
Plans = Annotated[
    list[str] | None,
    typer.Option(
        "--plan",
        metavar=f"[{'|'.join((*PLANS, ALL))}]",
        help="Which patterns; may be given several times. all: whatever can be captured. Default: full.",
    ),
]


def plans_from(given: list[str] | None) -> tuple[PlanChoice, ...]:
    """The plans that the option names, each once; "full" where it is not given. A usage error for other words."""
    if not given:
        return _DEFAULT
    chosen = names_from(",".join(given), (*PLANS, ALL), "--plan")
    return tuple(name for name in PLANS if name in chosen or ALL in chosen)
