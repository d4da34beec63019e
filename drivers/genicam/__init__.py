"""What all drivers of GenICam cameras share: configuration, the order of settings, and the states of a camera."""

from drivers.genicam.configuration import GenicamConfiguration
from drivers.genicam.finding import FoundCamera

__all__ = ["FoundCamera", "GenicamConfiguration"]
