"""Geometric verification: two depth views aligned, and judged by what each saw of the other's points."""

from depthprint.verification.agreement import ViewAgreement, view_agreement
from depthprint.verification.depth_view import DepthView, make_depth_view
from depthprint.verification.settings import VerificationSettings, settings_for
from depthprint.verification.verifier import GeometricVerifier, Verification

__all__ = [
    "DepthView",
    "GeometricVerifier",
    "Verification",
    "VerificationSettings",
    "ViewAgreement",
    "make_depth_view",
    "settings_for",
    "view_agreement",
]
