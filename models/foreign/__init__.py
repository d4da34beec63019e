"""Recorded sets of other rigs: a manifest in TOML says what each file is, and the set becomes a capture."""

from models.foreign.importer import import_capture
from models.foreign.manifest import Manifest, read_manifest

__all__ = ["Manifest", "import_capture", "read_manifest"]
