"""Whether the process lives, and whether it can work."""

from __future__ import annotations

from fastapi import APIRouter, Response
from pydantic import BaseModel, Field

from models.refiner.shipped import DEFAULT
from service.context import Service, ServiceDep

router = APIRouter(prefix="/v1/health", tags=["health"])


class Alive(BaseModel):
    """The process answers."""

    status: str = Field("ok", examples=["ok"])


class Check(BaseModel):
    """One thing that the service works with. needed: whether nothing works without it. detail: what is wrong with it,
    or what it is."""

    name: str = Field(examples=["rig"])
    ok: bool
    needed: bool = True
    detail: str = Field("", examples=["3 devices answer"])


class Readiness(BaseModel):
    """ready: a capture posted now can succeed."""

    ready: bool
    checks: list[Check]


@router.get("/live", operation_id="getLiveness", summary="The process answers")
async def live() -> Alive:
    return Alive(status="ok")


@router.get(
    "/ready",
    operation_id="getReadiness",
    summary="Rig and storage answer",
    responses={503: {"model": Readiness, "description": "Not ready; the checks say why"}},
)
def ready(service: ServiceDep, response: Response) -> Readiness:
    checks = [_rig(service), _storage(service), _weights(service)]
    result = Readiness(ready=all(check.ok or not check.needed for check in checks), checks=checks)
    response.status_code = 200 if result.ready else 503
    return result


def _rig(service: Service) -> Check:
    orchestrator = service.orchestrator
    if orchestrator.connected:
        busy = f"busy ({orchestrator.holder})" if orchestrator.holder else "idle"
        return Check(name="rig", ok=True, detail=busy)
    failures = "; ".join(orchestrator.failures.values())
    return Check(name="rig", ok=False, detail=failures or "not connected; POST /v1/rig/connect")


def _storage(service: Service) -> Check:
    fault = service.library.fault()
    free = f"{service.library.free_bytes / 1e9:.1f} GB free" if fault is None else ""
    return Check(name="storage", ok=fault is None, detail=fault or free)


def _weights(service: Service) -> Check:
    fault = service.weights.fault()
    detail = f"{DEFAULT} serves" if fault is None else f"{fault}; reconstructing with wft by default"
    return Check(name="weights", ok=fault is None, needed=False, detail=detail)
