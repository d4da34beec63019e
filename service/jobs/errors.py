"""Why a job is not taken, or not changed; each is one line for a person."""

from __future__ import annotations

from models.errors import DatasetError, DuofringeError


class JobsFullError(DuofringeError):
    """Too many jobs wait already."""

    def __init__(self, waiting: int) -> None:
        super().__init__(f"{waiting} jobs wait already; cancel one, or try again later")
        self.retry_after_s = 60


class JobStateError(DuofringeError):
    """A job is not in a state in which that can be done."""


class WeightsTakenError(DuofringeError):
    """The name that a training is to give its weights belongs to others."""


class UnknownDatasetError(DatasetError):
    """No dataset of the service has that name."""
