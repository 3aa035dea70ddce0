"""The command line, ``sympol``: one module a command, its arguments beside it."""

from .app import main

__all__ = ["main"]
