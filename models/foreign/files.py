"""File names of a foreign set: templates, lists and sequences, and where they may lead."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from models.errors import ManifestError
from models.geometry.rig import SIDES, Side

MAXIMUM_FILE_BYTES = 256 << 20
MAXIMUM_MATCHES = 4096
SKIP = "skip"
_FIELD = re.compile(r"\{([^{}]*)\}")
_NUMBER = re.compile(r"n(?::0(?P<width>[1-9])d?)?")
_SLOT = re.compile(r"(?P<group>high|low|gray_inv|gray)_(?P<index>\d{1,3})")

Template = str | tuple[str, ...]


@dataclass(frozen=True)
class FileNames:
    """A name template, or a list of names, for both views (key None) or for each."""

    by_view: Mapping[Side | None, Template]

    def of(self, side: Side) -> Template | None:
        return self.by_view.get(side, self.by_view.get(None))


@dataclass(frozen=True)
class Slot:
    """Place of one file of a sequence: the ``index``-th image of ``group``, in the set's own order."""

    group: str
    index: int


def parse_file_names(value: Any) -> FileNames:
    """Accept a template, a list of names, or a table of these by view; raises ValueError otherwise."""
    if isinstance(value, dict):
        unknown = sorted(set(value) - set(SIDES))
        if unknown or not value:
            raise ValueError(f"a table of file names has the keys left and right, not {unknown or 'none'}")
        return FileNames({side: _template(value[side]) for side in SIDES if side in value})
    return FileNames({None: _template(value)})


def _template(value: Any) -> Template:
    if isinstance(value, str) and value:
        return value
    if isinstance(value, list) and value and all(isinstance(name, str) and name for name in value):
        return tuple(value)
    raise ValueError("expected a file name with {view} and {n}, a list of file names, or a table of these by view")


def fill_template(template: str, word: str, number: int | None) -> str:
    """``{view}`` becomes the view's word, ``{n}`` the number, ``{n:03}`` the number with leading zeros.

    Nothing else is replaced: Python's own formatting would reach into objects. Raises ManifestError for other fields.
    """

    def replace(match: re.Match[str]) -> str:
        if match[1] == "view":
            return word
        form = _NUMBER.fullmatch(match[1])
        if form is None or number is None:
            raise ManifestError(f"file name '{template}': {{{match[1]}}} is not one of {{view}}, {{n}}, {{n:02}}")
        return str(number).zfill(int(form["width"] or 0))

    return _FIELD.sub(replace, template)


def group_files(names: FileNames, side: Side, word: str, group: str, numbers: Sequence[int]) -> list[str]:
    """Relative file names of a group in the set's own order; raises ManifestError naming the group."""
    template = names.of(side)
    if template is None:
        raise ManifestError(f"{group}: has no files for the {side} view")
    if isinstance(template, tuple):
        if len(template) != len(numbers):
            raise ManifestError(f"{group}: lists {len(template)} files but the group has {len(numbers)} images")
        return [fill_template(name, word, None) for name in template]
    if min(numbers) < 0:
        raise ManifestError(f"{group}: file number {min(numbers)} is negative; mend first or stride")
    if len(numbers) == 1 and "{n" not in template:
        return [fill_template(template, word, None)]
    filled = [fill_template(template, word, n) for n in numbers]
    if len(set(filled)) != len(filled):
        raise ManifestError(f"{group}: file name '{template}' lacks {{n}}; it names one file for {len(numbers)} images")
    return filled


def expand_order(order: Sequence[str], sizes: Mapping[str, int]) -> list[Slot]:
    """Places of the files of a sequence; a group's name stands for all its images, ``skip`` for an unused file.

    Single images of a group are named ``gray_00``, ``gray_inv_00`` ... Raises ValueError for unknown words and for
    groups that are not there whole and once.
    """
    slots: list[Slot] = []
    for word in order:
        match = _SLOT.fullmatch(word)
        if word == SKIP:
            slots.append(Slot(SKIP, 0))
        elif match is not None and match["group"] in sizes:
            slots.append(Slot(match["group"], int(match["index"])))
        elif word in sizes:
            slots.extend(Slot(word, i) for i in range(sizes[word]))
        else:
            raise ValueError(f"sequence.order: '{word}' is neither '{SKIP}' nor a described group")
    for group in {slot.group for slot in slots} - {SKIP}:
        indices = sorted(slot.index for slot in slots if slot.group == group)
        if indices != list(range(sizes[group])):
            raise ValueError(f"sequence.order: {group} must stand there once with its {sizes[group]} images")
    return slots


def sequence_files(folder: Path, template: str, word: str, slots: Sequence[Slot]) -> dict[Slot, str]:
    """Relative file names of the slots of a sequence, from the naturally sorted matches of a glob pattern.

    Raises ManifestError when there are more or fewer files than slots.
    """
    pattern = fill_template(template, word, None)
    _require_inside(pattern)
    if "**" in pattern:
        raise ManifestError(f"sequence.files '{template}': '**' is not taken; name the folder")
    matches = sorted(
        (path.relative_to(folder).as_posix() for path in folder.glob(pattern) if path.is_file()), key=_natural
    )
    if len(matches) > MAXIMUM_MATCHES:
        raise ManifestError(f"sequence.files '{pattern}': matches more than {MAXIMUM_MATCHES} files")
    if len(matches) != len(slots):
        raise ManifestError(
            f"sequence.files '{pattern}': matches {len(matches)} files in '{folder}' "
            f"but sequence.order describes {len(slots)}"
        )
    return {slot: name for slot, name in zip(slots, matches, strict=True) if slot.group != SKIP}


def _natural(name: str) -> list[tuple[int, int, str]]:
    """Sort key under which img_2 comes before img_10."""
    parts = re.split(r"(\d+)", name)
    return [(1, int(part), "") if part.isdigit() else (0, 0, part) for part in parts]


def _require_inside(name: str) -> None:
    path = PurePosixPath(name)
    if path.is_absolute() or "\\" in name or "\0" in name or ".." in path.parts:
        raise ManifestError(f"file name '{name}': must be relative and stay inside the folder (no '..')")


def resolve_file(folder: Path, name: str, group: str) -> Path:
    """The file ``name`` inside ``folder``.

    Raises ManifestError when it is missing, too large, or outside: by its name, or through a symbolic link.
    """
    _require_inside(name)
    path = folder / name
    try:
        if not path.resolve().is_relative_to(folder.resolve()):
            raise ManifestError(f"{group}: '{name}' leads out of '{folder}'")
        if not path.is_file():
            raise ManifestError(f"{group}: file '{path}' does not exist")
        if path.stat().st_size > MAXIMUM_FILE_BYTES:
            raise ManifestError(f"{group}: file '{path}' is larger than {MAXIMUM_FILE_BYTES >> 20} MiB")
    except (OSError, RuntimeError) as error:  # a name too long for the file system, or a loop of links
        raise ManifestError(f"{group}: file name '{name[:80]}' cannot be opened") from error
    return path
