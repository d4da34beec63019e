"""A bench without hardware on it: programs that speak the devices' own languages, before a simulated scene.

Two simulated Grasshopper3 answer on loopback addresses, an emulated DLPC350 on a USB or a serial port of its own, and
its trigger output pulses the cameras. The drivers, the libraries below them and everything above them are the real
ones, so an installation can be rehearsed, and a mistake in any of them shows in the points.
"""

from drivers.bench.bench import VirtualBench

__all__ = ["VirtualBench"]
