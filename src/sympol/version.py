"""The version of sympol, apart from the package's public face so that every module can read it."""

__version__ = "0.1.0"
