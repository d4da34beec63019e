"""The REST operations, one resource a file."""
