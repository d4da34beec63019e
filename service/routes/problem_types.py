"""What the ``type`` of a problem means: every one is an address that answers."""

from __future__ import annotations

from fastapi import APIRouter
from pydantic import BaseModel
from starlette.exceptions import HTTPException

from service.problems import PROBLEM_TYPES, ProblemType
from service.routes.documented import problems

router = APIRouter(prefix="/v1/problems", tags=["problems"])


class ProblemTypeView(BaseModel):
    """A kind of problem. remedy: what a client does about it."""

    type: str
    status: int
    title: str
    remedy: str

    @classmethod
    def of(cls, kind: ProblemType) -> ProblemTypeView:
        return cls(type=kind.uri, status=kind.status, title=kind.title, remedy=kind.remedy)


@router.get("", operation_id="listProblemTypes", summary="All kinds of problems")
async def list_types() -> list[ProblemTypeView]:
    return [ProblemTypeView.of(kind) for kind in PROBLEM_TYPES.values()]


@router.get("/{slug}", operation_id="getProblemType", summary="One kind of problem", responses=problems(404))
async def get(slug: str) -> ProblemTypeView:
    if slug not in PROBLEM_TYPES:
        raise HTTPException(404, f"there is no problem type '{slug[:64]}'")
    return ProblemTypeView.of(PROBLEM_TYPES[slug])
