"""Recorded captures, shown again bit for bit."""
