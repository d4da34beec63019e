"""The command line ``duofringe``: one command a file."""

from service.cli.app import main

__all__ = ["main"]
