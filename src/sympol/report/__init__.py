"""Runs as web pages: one policy in full, or several side by side."""

from .compare import compare
from .page import report
from .policies import policy_of

__all__ = ["compare", "policy_of", "report"]
