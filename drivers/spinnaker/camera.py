"""A GenICam camera that is reached through Spinnaker."""

from __future__ import annotations

from drivers.genicam.camera import GenicamCamera
from drivers.spinnaker.connection import SpinnakerConnection


class SpinnakerCamera(GenicamCamera):
    """Implements Camera, EdgeTriggered and SoftwareTriggered.

    A frame's ``host_ns`` is when it was fetched: Spinnaker does not tell when it came.
    """

    _driver = "spinnaker"

    def _connect(self) -> SpinnakerConnection:
        return SpinnakerConnection(self._name, self._configuration)
