"""A policy as one web page that needs nothing else: no network, no files beside it."""

from .html import programs_data, size_facts, to_html
from .page import write_page
from .policy import packed, policy_data

__all__ = ["packed", "policy_data", "programs_data", "size_facts", "to_html", "write_page"]
