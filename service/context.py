"""What every operation of the service works with, made at start and closed at the end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from fastapi import Depends, Request

from service.acquisition.orchestrator import Orchestrator
from service.acquisition.watch import RigWatch
from service.compute import ComputeLane
from service.jobs.jobs import Jobs
from service.library import Library
from service.settings import ServiceSettings
from service.weights import WeightsShelf


@dataclass(frozen=True, eq=False)
class Service:
    """One rig and who looks after it, one library, one compute lane, the refiner's weights, and the jobs."""

    settings: ServiceSettings
    orchestrator: Orchestrator
    library: Library
    compute: ComputeLane
    weights: WeightsShelf
    watch: RigWatch
    jobs: Jobs

    def close(self) -> None:
        """Leave the rig safe first, interrupt the jobs, finish what computes, then let go of the library."""
        self.watch.close()
        self.orchestrator.close()
        self.jobs.close()
        self.compute.close()
        self.library.close()


def service_of(request: Request) -> Service:
    """The service behind a request."""
    service = request.app.state.service
    assert isinstance(service, Service)
    return service


ServiceDep = Annotated[Service, Depends(service_of)]
