"""What stands before devices that are not hardware: a simulated scene or a recorded capture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

from models.capture import Truth
from models.geometry.rig import Rig


@runtime_checkable
class Stage(Protocol):
    """The scenes that a rig without hardware can be shown, one at a time."""

    @property
    def scenes(self) -> Sequence[str]:
        """Names that ``place`` takes, in order; of an endless series the first ones."""
        ...

    @property
    def scene(self) -> str:
        """The scene that stands there now."""
        ...

    def place(self, name: str | None = None) -> str:
        """Put a scene before the devices and return its name.

        None: whichever is next (recorded captures go round in name order; a simulated scene stays).
        Raises DeviceNotFoundError for an unknown name, CaptureError where a recorded capture is damaged.
        """
        ...

    @property
    def calibration(self) -> Rig | None:
        """Calibration of the devices as they see the present scene; None where it is unknown."""
        ...

    @property
    def truth(self) -> Truth | None:
        """What is known of the present scene, on the left sensor's grid."""
        ...

    @property
    def provenance(self) -> dict[str, Any]:
        """Where the present scene comes from, as JSON values; goes into the record of each capture."""
        ...

    @property
    def object_id(self) -> str | None:
        """Identity of the object in the present scene, where known."""
        ...
