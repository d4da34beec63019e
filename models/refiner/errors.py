"""What a person can mend about the refiner."""

from models.errors import DuofringeError


class RefinerError(DuofringeError):
    """Weights are damaged, foreign or for other fringes, or a refiner's input or configuration is impossible."""
