"""GenICam cameras over USB3 Vision and GigE Vision, through the library Aravis (LGPL, loaded at run time)."""

from drivers.aravis.camera import AravisCamera
from drivers.aravis.discovery import find_cameras

__all__ = ["AravisCamera", "find_cameras"]
