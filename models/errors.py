"""Errors a person can mend. The text of each is one line: what is wrong, where, and what to do about it."""


class DuofringeError(Exception):
    """Root of every expected failure; the command line prints its text and exits with status 1."""


class CalibrationError(DuofringeError):
    """A rig calibration is missing, unreadable or impossible."""


class CaptureError(DuofringeError):
    """A capture folder is damaged, incomplete, or lacks what a method needs."""


class ManifestError(DuofringeError):
    """The manifest of a foreign set does not describe what is in its folder."""


class DatasetError(DuofringeError):
    """A dataset folder is damaged or does not hold what was asked for."""


class ReconstructionError(DuofringeError):
    """Images were readable but gave no trustworthy cloud."""


class ExportError(DuofringeError):
    """A result cannot be written where or how it was asked."""
