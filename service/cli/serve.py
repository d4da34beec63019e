"""``duofringe serve``: the REST service."""

from __future__ import annotations

import signal
import socket
from types import FrameType
from typing import TYPE_CHECKING, Annotated

import typer

from service.cli import console
from service.cli.rig_options import Config, Driver, Replay, settings_from

if TYPE_CHECKING:
    import uvicorn

    from service.context import Service
    from service.settings import ServerSettings

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

    with _listener(settings.server) as listener:
        service = open_service(settings)
        try:
            server = _server(service, create_app(service))
            where = _address(settings.server.host, listener.getsockname()[1])
            console.note(f"duofringe: library {settings.library.folder}, serving on {where} (described at /docs)")
            server.run(sockets=[listener])
        finally:
            service.close()
    if not server.started:
        raise SystemExit(1)


def _listener(settings: ServerSettings) -> socket.socket:
    """Bound, so that port 0 has become a number, and not listening yet. Raises ConfigurationError."""
    from service.settings import ConfigurationError

    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    # asyncio sets TCP_NODELAY only where the protocol is named; without it every answer waits 40 ms for an ACK
    listener = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((settings.host, settings.port))
    except OSError as error:
        listener.close()
        where = _address(settings.host, settings.port)
        raise ConfigurationError(
            f"{where} cannot be served ({error.strerror}); choose another --host or --port, or stop what is there"
        ) from error
    return listener


def _address(host: str, port: int) -> str:
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"


def _server(service: Service, app: object) -> uvicorn.Server:
    import uvicorn

    class Server(uvicorn.Server):
        """Ends live streams and a running capture at the signal, so that shutting down does not wait for them.

        A signal is how a service ends as it should: it is not raised again after, so the exit status is 0.
        """

        def handle_exit(self, sig: int, frame: FrameType | None) -> None:
            service.orchestrator.live.end()
            service.orchestrator.cancel()
            self.force_exit = self.should_exit and sig == signal.SIGINT
            self.should_exit = True

    return Server(
        uvicorn.Config(
            app,  # type: ignore[arg-type]  # any ASGI application
            timeout_graceful_shutdown=_GRACE_S,
            server_header=False,
            log_config=None,
        )
    )
