"""The configuration under its old name."""

from drivers.genicam.configuration import GenicamConfiguration as AravisConfiguration

__all__ = ["AravisConfiguration"]
