"""Which phase method reconstructs a capture: the one asked for, or the best that its patterns allow."""

from __future__ import annotations

from dataclasses import dataclass

from models.capture import Capture
from models.errors import CaptureError
from models.patterns import PatternKind
from models.reconstruct import Method
from models.refiner.errors import RefinerError
from service.weights import NamedWeights, WeightsShelf


@dataclass(frozen=True)
class MethodChoice:
    """asked: None for the best. weights: of the refiner; None where another method is asked for, or none serve."""

    asked: Method | None
    weights: NamedWeights | None

    @property
    def needs(self) -> frozenset[PatternKind]:
        """A capture must have one of these."""
        if self.asked is None:
            return frozenset({"composite", "high"})
        return frozenset({"high"}) if self.asked == "nstep" else frozenset({"composite"})

    def method_for(self, capture: Capture) -> Method:
        """The method for a capture, of which the composite has to be read where there is one.

        Raises RefinerError where the refiner is asked for and the weights are for other fringes, CaptureError where
        nothing is asked for and the capture serves no method.
        """
        composite = capture.plan.of_kind("composite")
        if self.asked is not None:
            if self.asked == "refiner" and self.weights is not None and composite:
                self.weights.require_periods(composite[0].periods)
            return self.asked
        if composite:
            fit = self.weights is not None and self.weights.record.periods == composite[0].periods
            return "refiner" if fit else "wft"
        if "high" not in capture.plan.kinds:
            raise CaptureError(
                f"{capture.source}: has neither a composite nor phase-shifted fringes; capture with plan composite"
            )
        return "nstep"


def choose(shelf: WeightsShelf, method: Method | None, weights: str | None) -> MethodChoice:
    """What is asked for, with the weights that it takes; None for the best method, and for the default weights.

    Raises RefinerError where the refiner is asked for and its weights are unknown or damaged, ComputeBusyError.
    """
    if method not in (None, "refiner"):
        return MethodChoice(method, None)
    try:
        return MethodChoice(method, shelf.get(weights))
    except RefinerError:
        if method is not None:
            raise
        return MethodChoice(None, None)
