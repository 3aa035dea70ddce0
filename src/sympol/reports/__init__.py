"""Runs as web pages: one policy in full, or several side by side."""

from .compare import compare
from .policies import policy_of
from .report import report

__all__ = ["compare", "policy_of", "report"]
