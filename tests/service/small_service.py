"""The whole application on a small virtual rig, in this process."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

from fastapi import FastAPI
from starlette.testclient import TestClient

from drivers.virtual.bench import Bench
from drivers.virtual.rig import bench_of, virtual_rig
from drivers.virtual.source import SceneSource
from models.geometry.rig import Rig
from service.acquisition.orchestrator import Orchestrator
from service.acquisition.settings import AcquisitionSettings
from service.acquisition.watch import RigWatch
from service.app import create_app
from service.compute import ComputeLane
from service.context import Service
from service.jobs.jobs import Jobs
from service.library import Library, LibraryLimits
from service.settings import ServiceSettings
from service.weights import WeightsShelf


@dataclass(frozen=True, eq=False)
class SmallService:
    """A running application, a client of it, and the bench behind its devices."""

    service: Service
    app: FastAPI
    client: TestClient
    bench: Bench

    @property
    def folders(self) -> list[str]:
        """Names of everything in the library's folder of captures."""
        return sorted(path.name for path in (self.service.library.root / "captures").iterdir())


@contextmanager
def small_service(
    source: SceneSource,
    library: Path,
    *,
    realtime: bool = False,
    calibration: Rig | None = None,
    weights: Path | None = None,
    **settings: Any,
) -> Iterator[SmallService]:
    """Without the warm-up, which takes longer than what most tests do.

    weights: the service's own folder of them. settings: as in the configuration.
    """
    configured = ServiceSettings(
        library={"folder": library, "minimum_free_bytes": 0, "weights_folder": weights},  # type: ignore[arg-type]
        **{"acquisition": AcquisitionSettings(retakes=0), **settings},
    )
    devices = virtual_rig(source, realtime=realtime, calibration=calibration)
    opened = Library.open(library, LibraryLimits(minimum_free_bytes=0))
    orchestrator = Orchestrator(devices, configured.acquisition)
    compute = ComputeLane()
    shelf = WeightsShelf(configured.library.weights, compute)
    jobs = Jobs.open(opened, shelf, configured.library.datasets)
    service = Service(configured, orchestrator, opened, compute, shelf, RigWatch(orchestrator), jobs)
    app = create_app(service)
    warm_up = patch("service.app.warm_up")
    with warm_up, TestClient(app, base_url="http://localhost", raise_server_exceptions=False) as client:
        yield SmallService(service, app, client, bench_of(devices))
