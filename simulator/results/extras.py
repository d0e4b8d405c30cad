"""What is said where a package is missing that comes with an extra."""

from __future__ import annotations


class MissingExtra(ImportError):
    """A package that comes with an extra is not installed; the message names the extra."""
