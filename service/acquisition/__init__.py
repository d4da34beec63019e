"""From devices to a capture that is proven good: order of steps, checks, audit, retakes."""
