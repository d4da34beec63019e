"""What the operations on reconstructions do, apart from HTTP."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, model_validator

from models.capture import Capture
from models.errors import DuofringeError, ReconstructionError
from models.reconstruct import Method, Reconstruction, ReconstructionOptions, kinds_needed, reconstruct
from models.stereo.matcher import Matching
from service.acquisition.request import LONGEST_PLAN, PLAN_HELP, CaptureOptions, CaptureRequest, PlanField
from service.captures import already_stored, take
from service.context import Service
from service.library import StoredCapture, StoredReconstruction
from service.method_choice import MethodChoice, choose
from service.views import CaptureAndReconstructionAnswer, CaptureView, Clocks, ReconstructionView
from service.weights import NAME_PATTERN


class CaptureKeptError(DuofringeError):
    """The capture was taken and stored, but not reconstructed. cause: why not. capture: its id."""

    def __init__(self, cause: DuofringeError, capture: str) -> None:
        super().__init__(f"{cause}; the capture was kept as {capture}")
        self.cause = cause
        self.capture = capture


class OptionsRequest(BaseModel):
    """How to reconstruct."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    method: Method | None = Field(
        None,
        description="nstep: the reference's exposures. The others: one composite exposure. By default the best that "
        "the capture allows: refiner where the default weights are for its fringes, else wft; nstep without a "
        "composite.",
        examples=["refiner"],
    )
    weights: str | None = Field(
        None,
        pattern=NAME_PATTERN,
        description="Of the method refiner, which they ask for: name of shipped weights or of a folder in the "
        "service's weights folder. By default the shipped ones.",
        examples=["sim"],
    )
    matching: Matching | None = Field(
        None, description="By default trinocular where the calibration has a projector, else stereo."
    )
    depth_range: tuple[float, float] | None = Field(
        None, description="(min, max) mm; by default the rig's working range.", examples=[[400, 670]]
    )
    device: str = Field("cpu", pattern=r"^(cpu|cuda(:\d{1,2})?)$", description="Where the phase stage runs.")

    @model_validator(mode="after")
    def _range_is_one(self) -> OptionsRequest:
        if self.depth_range is not None and not 0 < self.depth_range[0] < self.depth_range[1] < 1e6:
            raise ValueError("depth_range: 0 < MIN < MAX < 1e6 mm")
        return self

    @model_validator(mode="after")
    def _weights_are_the_refiner_s(self) -> OptionsRequest:
        if self.weights is not None and self.method not in (None, "refiner"):
            raise ValueError(f"weights: method {self.method} takes none; only refiner does")
        return self

    @property
    def asked(self) -> Method | None:
        """The method, which weights name as well; None for the best."""
        return self.method if self.weights is None else "refiner"

    def require_device(self) -> None:
        """Raise ReconstructionError for a device that is not here."""
        if self.device != "cpu":
            import torch  # a second of import that only a request for CUDA needs to wait for here

            index = int(self.device.partition(":")[2] or 0)
            if index >= torch.cuda.device_count():
                raise ReconstructionError(f"device '{self.device}' is not in this computer; use cpu")

    def options(self, choice: MethodChoice, capture: Capture) -> ReconstructionOptions:
        """For one capture. Raises as ``MethodChoice.method_for``."""
        method = choice.method_for(capture)
        weights = str(choice.weights.folder) if method == "refiner" and choice.weights is not None else None
        return ReconstructionOptions(method, self.matching, self.depth_range, self.device, weights)


class ReconstructionRequest(OptionsRequest):
    """One stored capture to reconstruct."""

    capture: str = Field(max_length=64, description="Id of a capture.")


class CaptureAndReconstructionRequest(CaptureOptions, OptionsRequest):
    """Take a capture and reconstruct it."""

    plan: PlanField | None = Field(
        None, max_length=LONGEST_PLAN, description=f"By default what the method needs. {PLAN_HELP}"
    )

    def capture_request(self) -> CaptureRequest:
        """Its capture alone."""
        plan = self.plan if self.plan is not None else "reference" if self.asked == "nstep" else "composite"
        options = {name: getattr(self, name) for name in CaptureOptions.model_fields}
        return CaptureRequest(plan=plan, **options)


def reconstruct_stored(service: Service, request: ReconstructionRequest, reconstruction_id: str) -> ReconstructionView:
    """Reconstruct a capture of the library and store the result."""
    request.require_device()
    service.library.require_space()
    choice = choose(service.weights, request.asked, request.weights)
    capture = service.library.captures.read(request.capture, kinds=kinds_needed(choice.asked or "wft"))
    if choice.asked is None and not capture.plan.patterns:
        capture = service.library.captures.read(request.capture, kinds=kinds_needed("nstep"))
    options = request.options(choice, capture)
    result = _named(service.compute.submit(lambda: reconstruct(capture, options)).result(), choice)
    stored = service.library.reconstructions.add(result, request.capture, _extra(capture), id=reconstruction_id)
    return ReconstructionView.of(stored)


def capture_and_reconstruct(
    service: Service, request: CaptureAndReconstructionRequest, capture_id: str
) -> CaptureAndReconstructionAnswer:
    """The main call. The capture is stored while it is reconstructed, and stays when that fails: the error names it.

    Raises what ``Orchestrator.capture`` and ``reconstruct`` raise.
    """
    started = time.perf_counter()
    request.require_device()
    wanted = request.capture_request()
    finished_before = already_stored(service, capture_id)
    if finished_before is not None:
        return _resume(service, request, finished_before, started)
    choice = choose(service.weights, request.asked, request.weights)
    outcome = take(service, wanted, capture_id, needs=choice.needs)
    captured = time.perf_counter()
    try:
        options = request.options(choice, outcome.capture)
        computing = service.compute.submit(lambda: reconstruct(outcome.capture, options))
    except DuofringeError as error:
        service.library.captures.add(outcome.capture, capture_id)
        raise CaptureKeptError(error, capture_id) from error
    stored = service.library.captures.add(outcome.capture, capture_id)
    stored_after = time.perf_counter() - captured
    try:
        result = _named(computing.result(), choice)
        computed = time.perf_counter()
        saved = service.library.reconstructions.add(result, capture_id, _extra(outcome.capture))
    except DuofringeError as error:
        raise CaptureKeptError(error, capture_id) from error
    done = time.perf_counter()
    timings = {
        **{f"capture.{step}": seconds for step, seconds in outcome.timings_s.items()},
        **{f"reconstruction.{step}": seconds for step, seconds in result.timings_s.items()},
        "capture": captured - started,
        "store_capture": stored_after,
        "reconstruction": computed - captured,
        "store_reconstruction": done - computed,
        "total": done - started,
    }
    clocks = Clocks(acquisition_s=outcome.acquisition_s, result_s=done - started)
    return _answer(stored, saved, outcome.attempts, timings, clocks)


def _resume(
    service: Service, request: CaptureAndReconstructionRequest, stored: StoredCapture, started: float
) -> CaptureAndReconstructionAnswer:
    """Finish what was begun before the service was interrupted: the capture exists, the rig does not move again."""
    again = ReconstructionRequest(
        capture=stored.id, **{name: getattr(request, name) for name in OptionsRequest.model_fields}
    )
    view = reconstruct_stored(service, again, service.library.new_id())
    saved = service.library.reconstructions.get(view.id)
    total = time.perf_counter() - started
    return _answer(stored, saved, 1, {"total": total}, Clocks(acquisition_s=0.0, result_s=total))


def _named(result: Reconstruction, choice: MethodChoice) -> Reconstruction:
    """The record names the weights, not where this computer keeps them."""
    if result.weights is None or choice.weights is None:
        return result
    return replace(result, options=replace(result.options, weights=choice.weights.name))


def _extra(capture: Capture) -> dict[str, Any]:
    """What a reconstruction takes over from its capture: its warnings hold for the cloud as well."""
    return {"warnings": list(capture.record.warnings)}


def _answer(
    stored: StoredCapture, saved: StoredReconstruction, attempts: int, timings: dict[str, float], clocks: Clocks
) -> CaptureAndReconstructionAnswer:
    reconstruction = ReconstructionView.of(saved)
    return CaptureAndReconstructionAnswer(
        capture=CaptureView.of(stored),
        reconstruction=reconstruction,
        attempts=attempts,
        timings_s=timings,
        clocks=clocks,
        links=reconstruction.links,
    )
