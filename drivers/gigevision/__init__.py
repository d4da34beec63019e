"""A Grasshopper3 that exists only as a program: GigE Vision on a loopback address, with a trigger line to pulse.

It stands where a camera on the desk would, so that a driver is tried through its real library and real sockets.
The register layout is our own; feature names and rules follow the camera's reference.
"""

from drivers.gigevision.faults import TriggerFaults
from drivers.gigevision.server import SimulatedGrasshopper

__all__ = ["SimulatedGrasshopper", "TriggerFaults"]
