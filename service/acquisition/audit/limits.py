"""Every threshold of the audit, in one place."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field


class AuditLimits(BaseModel):
    """When a sequence is warned of and when it is refused.

    Levels are shares of the white level, angles radians.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    lit_modulation: float = Field(3 / 255, gt=0)
    """Fringe amplitude from which a pixel counts as lit; up to ``sure_modulation`` where the images are noisy."""
    sure_modulation: float = Field(8 / 255, gt=0)
    """Fringe amplitude that is lit under any noise; a view whose median is below it gets a warning."""
    least_light: float = Field(6 / 255, gt=0)
    """A view whose brightest half per cent of pixels change less than this over the sequence is dark."""
    least_lit: float = Field(0.002, ge=0, le=1)
    """Share of the view that must be lit."""
    sampled_pixels: int = Field(6000, ge=500)
    """Lit pixels a view on which the order is proven."""
    contradiction: float = Field(0.35, gt=0, lt=1)
    """How far a frame may lie on the way from its own pattern (0) to another of the plan (1)."""
    proof: float = Field(0.25, gt=0, lt=1)
    """A frame that is nearer to its own pattern than this is proven."""
    misfit: float = Field(0.6, gt=0)
    """Share of a fringe's energy that the fit may leave unexplained."""
    low_phase: float = Field(0.35, gt=0)
    """Largest difference between the low phase and the one that the decoded column predicts, for a consistent pixel."""
    consistent: float = Field(0.5, gt=0, lt=1)
    """Share of pixels, or of steps between fringes, at which the code planes must agree with the phases."""
    torn: float = Field(0.5, gt=0, lt=1)
    """As ``contradiction``, in each quarter of the view's rows: a frame that changes its pattern half-way down."""
    moved_phase: float = Field(0.35, gt=0)
    """Phase by which a block of the composite must differ from the prediction to have moved."""
    moved_level: float = Field(0.05, gt=0)
    """Difference between the means of two carriers, as a share of the level, from which a block moved."""
    moved_blocks: float = Field(0.01, gt=0, lt=1)
    """Share of moved blocks from which the scene moved."""
    saturated_warning: float = Field(0.01, ge=0, le=1)
    """Share of lit pixels at the white level, in any image, that is worth a warning."""
    saturated_fatal: float = Field(0.25, ge=0, le=1)
    """Share from which the sequence is refused."""
    under_exposed_warning: float = Field(0.25, ge=0, le=1)
    """Share of lit pixels with a fringe amplitude under ``sure_modulation`` that is worth a warning."""
    ambient_warning: float = Field(0.3, gt=0, le=1)
    """Median level of the black frame at lit pixels, as a share of the white frame's, that is worth a warning."""
    composite_contrast: float = Field(4 / 255, gt=0)
    """Standard deviation along a row from which a stretch of a single composite has fringes."""
    little_lit: float = Field(0.03, ge=0, le=1)
    """A single composite of which less than this share is lit cannot be told from a wrong one and is only warned of."""
    narrow: int = Field(320, ge=0)
    """Width, px, of a view below which a single composite is only warned of: an object's edges fill most stretches."""
    two_carriers: float = Field(0.25, gt=0, lt=1)
    """Share of fringed stretches of a single composite that must show both carriers."""
