"""The folder of captures and reconstructions."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator

from service.diagnosis.symptom import Symptom
from service.settings import ServiceSettings


def examine_library(settings: ServiceSettings) -> Iterator[Symptom]:
    folder = settings.library.folder
    existing = next((path for path in (folder, *folder.absolute().parents) if path.exists()), folder)
    if not existing.is_dir() or not os.access(existing, os.W_OK | os.X_OK):
        yield Symptom("library", "fault", f"'{existing}' cannot be written to", "set library.folder or its permissions")
        return
    free = shutil.disk_usage(existing).free
    text = f"{folder}, {free / 1e9:.1f} GB free"
    if free < settings.library.minimum_free_bytes:
        limit = f"{settings.library.minimum_free_bytes / 1e9:.1f} GB must stay free"
        yield Symptom("library", "fault", text, f"{limit}; delete captures or set library.folder to a larger disk")
    else:
        yield Symptom("library", "ok", text)
