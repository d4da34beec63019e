"""A rig without hardware: what simulated and replayed devices share."""
