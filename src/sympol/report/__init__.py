"""Runs as web pages: one policy in full, or several side by side."""

from .compare import compare
from .data import policy_of
from .page import report

__all__ = ["compare", "policy_of", "report"]
