"""Serial numbers, as people and buses write them."""

from __future__ import annotations


def same_serial(wanted: str, shown: str) -> bool:
    """On the USB, a serial number is often shown as hexadecimal digits."""
    if wanted.strip().lower() == shown.strip().lower():
        return True
    try:
        return int(wanted) == int(shown, 16)
    except ValueError:
        return False
