"""Surface material classification from acceleration traces and photos."""

__version__ = "0.1.0"
