"""A tree in other languages and formats: one module each, listed in `FORMATS`.

A new format is one module and one line in `formats`. The module has a function from a tree to text or bytes and, if
its programs can be run here, a function that does so; `check` compares what they answer with the tree.
"""

from .formats import FORMATS, SUFFIXES, Format, canonical, format_of

__all__ = ["FORMATS", "SUFFIXES", "Format", "canonical", "format_of"]
