"""Proof from the images alone that every frame of a sequence shows its pattern."""

from service.acquisition.audit.audit import audit
from service.acquisition.audit.limits import AuditLimits
from service.acquisition.audit.report import AuditReport

__all__ = ["AuditLimits", "AuditReport", "audit"]
