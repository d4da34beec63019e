"""``duofringe serve``: the REST service."""

from __future__ import annotations

from types import FrameType
from typing import TYPE_CHECKING, Annotated

import typer

from service.cli import console
from service.cli.rig_options import Config, Driver, Replay, settings_from

if TYPE_CHECKING:
    import uvicorn

    from service.context import Service

EXAMPLE = "Example: duofringe serve --driver simulated --port 8000"
_GRACE_S = 10


def register(app: typer.Typer) -> None:
    app.command("serve", epilog=EXAMPLE)(command)


def command(
    config: Config = None,
    driver: Driver = None,
    replay: Replay = None,
    host: Annotated[str | None, typer.Option(help="Address; without API keys only this computer's own.")] = None,
    port: Annotated[int | None, typer.Option(min=0, max=65535, help="Port; 0 takes a free one.")] = None,
) -> None:
    """Serve captures and reconstructions over REST until interrupted; the API is described at /docs."""
    import logging

    settings = settings_from(config, driver, replay, host=host, port=port)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(name)s: %(message)s")
    from service.app import create_app, open_service

    service = open_service(settings)
    try:
        server = _server(service, create_app(service))
        where = f"{settings.server.host}:{settings.server.port}"
        console.note(f"duofringe: library {settings.library.folder}, serving on http://{where} (described at /docs)")
        server.run()
    finally:
        service.close()
    if not server.started:
        raise SystemExit(1)


def _server(service: Service, app: object) -> uvicorn.Server:
    import uvicorn

    class Server(uvicorn.Server):
        """Ends live streams and a running capture at the signal, so that shutting down does not wait for them."""

        def handle_exit(self, sig: int, frame: FrameType | None) -> None:
            service.orchestrator.live.end()
            service.orchestrator.cancel()
            super().handle_exit(sig, frame)

    settings = service.settings.server
    return Server(
        uvicorn.Config(
            app,  # type: ignore[arg-type]  # any ASGI application
            host=settings.host,
            port=settings.port,
            timeout_graceful_shutdown=_GRACE_S,
            server_header=False,
            log_config=None,
        )
    )
