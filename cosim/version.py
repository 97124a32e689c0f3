"""The version of this code, which may be another than that of what is installed beside it."""

__version__ = "0.2.0"
