"""The pattern and the image LUT of an emulated controller, and the mailbox through which they are filled."""

from __future__ import annotations

from drivers.lightcrafter.values import LutControl, LutEntry


class Luts:
    """entries, indexes: by their offset, as sent. two_image_quirk: two indexes are read the other way round."""

    def __init__(self, *, two_image_quirk: bool) -> None:
        self.entries: dict[int, LutEntry] = {}
        self.indexes: dict[int, int] = {}
        self._quirk = two_image_quirk

    def clear(self) -> None:
        self.entries.clear()
        self.indexes.clear()

    def add_entries(self, offset: int, entries: tuple[LutEntry, ...]) -> None:
        self.entries.update({offset + k: entry for k, entry in enumerate(entries)})

    def add_indexes(self, offset: int, indexes: tuple[int, ...]) -> None:
        self.indexes.update({offset + k: index for k, index in enumerate(indexes)})

    def selected(self, control: LutControl) -> tuple[tuple[LutEntry, ...], tuple[int, ...]]:
        """What the controller plays: entries, and images in the order of their swaps."""
        entries = tuple(self.entries[k] for k in range(control.entries) if k in self.entries)
        images = tuple(self.indexes[k] for k in range(control.images) if k in self.indexes)
        return entries, images[::-1] if self._quirk and control.images == 2 else images
