"""A DLPC350 in software that speaks the controller's bytes over pyusb and pyserial."""
