"""A GenICam camera that is reached through Aravis."""

from __future__ import annotations

from drivers.aravis.connection import AravisConnection, connect
from drivers.genicam.camera import GenicamCamera


class AravisCamera(GenicamCamera):
    """Implements Camera, EdgeTriggered and SoftwareTriggered."""

    _driver = "aravis"

    def _connect(self) -> AravisConnection:
        return connect(self._name, self._configuration)
