"""The simulated rig: procedural or user-given scenes, ray-cast once, then exposed to any pattern."""
