"""GenICam cameras through FLIR's Spinnaker SDK and its module PySpin, loaded at run time where it is installed."""

from drivers.spinnaker.camera import SpinnakerCamera
from drivers.spinnaker.connection import find_cameras

__all__ = ["SpinnakerCamera", "find_cameras"]
