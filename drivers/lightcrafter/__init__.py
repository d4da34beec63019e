"""TI DLP LightCrafter 4500 (DLPC350 controller) over USB or over a serial I2C bridge."""
